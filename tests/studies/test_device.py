"""The study of devices, in this process, where another virtual CPU stands for the device."""

import importlib.util
import sys
from concurrent.futures import Future

import jax
import numpy as np
import pytest

import jaxbeam as jb
from tests.studies.common import STUDIES, rows_of

# A program for a GPU: a loop of four rounds of three kernels within one of unknown length that
# starts two more, one of them beside what follows; then a choice of one or three, and a last one.
PROGRAM = """
HloModule jit_f
%fused (p: f64[8]) -> f64[8] {
  ROOT %add.1 = f64[8]{0} add(%p, %p)
}
%inner (x: (f64[8])) -> (f64[8]) {
  %get.1 = f64[8]{0} get-tuple-element(%x), index=0
  %fusion.1 = f64[8]{0} fusion(%get.1), kind=kLoop, calls=%fused
  %call.1 = f64[8]{0} custom-call(%fusion.1), custom_call_target="cusolver_syevd_ffi"
  %copy.1 = f64[8]{0} copy(%call.1)
  ROOT %tuple.1 = (f64[8]{0}) tuple(%copy.1)
}
%outer (y: (f64[8])) -> (f64[8]) {
  %start.1 = ((f64[8]{0}), f64[8]{0}, u32[]) fusion-start(%y), kind=kLoop, calls=%fused
  %done.1 = f64[8]{0} fusion-done(%start.1)
  %fusion.2 = f64[8]{0} fusion(%done.1), kind=kLoop, calls=%fused
  %tuple.2 = (f64[8]{0}) tuple(%fusion.2)
  ROOT %while.1 = (f64[8]{0}) while(%tuple.2), condition=%c, body=%inner, backend_config={"known_trip_count":{"n":"4"}}
}
%few (y: (f64[8])) -> (f64[8]) {
  ROOT %copy.2 = (f64[8]{0}) copy(%y)
}
ENTRY %main (z: f64[8]) -> f64[8] {
  %while.2 = (f64[8]{0}) while(%z), condition=%c, body=%outer, metadata={op_name="while"}
  %if.1 = (f64[8]{0}) conditional(%p, %while.2, %while.2), branch_computations={%few, %inner}
  ROOT %fusion.3 = f64[8]{0} fusion(%if.1), kind=kLoop, calls=%fused
}
"""  # noqa: E501


@pytest.fixture
def device(monkeypatch):
    """The module of the study."""
    monkeypatch.syspath_prepend(str(STUDIES))
    monkeypatch.delitem(sys.modules, "common", raising=False)
    spec = importlib.util.spec_from_file_location("device", STUDIES / "device.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def devices(device, monkeypatch):
    """One that is not called a CPU, and one that is."""
    cpu, other = jax.devices()[:2]
    monkeypatch.setattr(device, "name_of", lambda d: "CPU" if d is cpu else "other")
    monkeypatch.setattr(device, "CORES", 2)
    return [other, cpu]


@pytest.mark.exhaustive
def test_devices_find_the_same(device, devices, tmp_path, capsys):
    """In batches of any size, case by case; every row is told, kept and drawn."""
    modes = device.curves(quick=True)[0]._replace(sizes=(256, 300))
    rows = device.study([modes], devices)
    assert [(r.device, r.cases) for r in rows] == [
        ("CPU", 256), ("CPU, 2 batches at once", 512), ("other", 256), ("other", 300),
    ]  # fmt: skip
    assert capsys.readouterr().out.count("% ok") == len(rows)
    for row in rows:
        assert row.fine == 1
        assert row.rate == pytest.approx(row.cases / row.seconds)
        assert (row.difference < 1e-10) == (row.device == "other")
    device.common.write_csv(tmp_path / "device.csv", device.Row._fields, rows)
    assert [r["cases"] for r in rows_of(tmp_path / "device.csv")] == ["256", "512", "256", "300"]
    device.draw(rows, tmp_path / "device.png")
    assert (tmp_path / "device.png").stat().st_size > 20_000


@pytest.mark.exhaustive
def test_what_ends_a_curve(device, devices, monkeypatch, capsys):
    """Memory that ends, and a run that would take too long; what would come next is not tried. A
    device that is wrong is found out, and a case that failed."""
    right = device.Curve("squares", "none", squares, np.ones((4096, 2)), (256, 512, 1024, 2048))
    compiling = device.compiling

    def short_of_memory(wanted, pool):
        for program in compiling(wanted, pool):
            if program.size == 1024:
                program.compiled.result()
                failed = Future()
                failed.set_exception(jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: too much"))
                program = program._replace(compiled=failed)
            if program.size == 512:
                cases = jax.device_put(right.cases[:512], program.device)
                wrong = jax.jit(lambda x: squares(1.001 * x)).lower(cases).compile()
                found = Future()
                found.set_result((wrong, 0.0))
                program = program._replace(compiled=found)
            yield program

    monkeypatch.setattr(device, "compiling", short_of_memory)
    *_, good, bad, last = device.study([right], devices)
    assert good.difference == 0
    assert bad.difference == pytest.approx(1.001**2 - 1)
    assert last.note.startswith("out of memory")
    assert np.isnan(last.rate)
    assert "out of memory: RESOURCE_EXHAUSTED: too much" in capsys.readouterr().out

    monkeypatch.setattr(device, "PATIENCE", 0.0)
    row = device.study([right._replace(sizes=(256, 2048, 4096))], devices)[-1]
    assert (row.cases, row.note[:8]) == (2048, "left out")

    one_failed = np.append(right.cases[1:], [[-1.0, 1.0]], 0)
    failed = right._replace(cases=one_failed, sizes=(4096,))
    monkeypatch.setattr(device, "PATIENCE", 30.0)
    assert device.study([failed], devices)[-1].fine == 1 - 1 / 4096


def squares(x):
    """A cheap curve, of which negative numbers fail."""
    status = jax.numpy.where(x[:, 0] < 0, jb.Status.NOT_FINITE, jb.Status.OK)
    return x**2, status


@pytest.mark.exhaustive
def test_expectations(device):
    """Of the next run: as much longer as cases are more on a CPU, and on a device that is full."""
    rows = [device.Row("", "", "", n, seconds=s) for n, s in ((2**8, 1.0), (2**11, 1.5))]
    assert device.expected([], 2**8, False) == 0
    assert device.expected(rows[:1], 2**11, False) == 1.0
    assert device.expected(rows, 2**14, False) == pytest.approx(1.5**2)
    assert device.expected(rows, 2**14, True) == pytest.approx(1.5 * 8)
    more = [*rows, device.Row("", "", "", 2**14, seconds=3.0)]
    assert device.expected(more, 2**17, False) == pytest.approx(24.0)


@pytest.mark.exhaustive
def test_kernels(device):
    assert device.kernels(PROGRAM) == 2 + 4 * 3 + 3 + 1
