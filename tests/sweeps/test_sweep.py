"""Labelled sweeps: layout, chunks, failures, files."""

import builtins
import gc
import weakref

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import slender
from tests.tiers import slow


def product(a, b):
    return {"sum": a + b, "pair": jnp.stack([a, b]), "wave": jnp.exp(1j * a)}


@pytest.mark.parametrize("chunk", [1, 4, 5, 7, 100])
def test_grid_layout_whatever_the_chunk(chunk):
    cases = jb.grid(a=[1, 2, 3], b=np.linspace(0, 1, 5))
    table = jb.sweep(product, cases, chunk=chunk, dims={"pair": {"which": ["a", "b"]}})
    a, b = np.meshgrid([1.0, 2.0, 3.0], np.linspace(0, 1, 5), indexing="ij")
    np.testing.assert_array_equal(table["sum"], a + b)
    np.testing.assert_array_equal(table["pair"], np.stack([a, b], -1))
    np.testing.assert_allclose(table["wave"], np.exp(1j * a))
    assert table.dims["pair"] == ("a", "b", "which")
    assert (table["status"] == 0).all()


def test_index_by_value():
    table = jb.sweep(product, jb.grid(a=[0.1, 0.2, 0.3], b=[0, 1, 2, 3]))
    assert table.sel(a=0.1 + 0.2, b=2)["sum"] == pytest.approx(2.3)
    assert table.sel(a=0.2)["sum"].shape == (4,)
    np.testing.assert_allclose(table.sel(a=0.1, b=slice(1, 2))["sum"], [1.1, 2.1])
    np.testing.assert_allclose(table.sel(a=0.1, b=[3, 0])["sum"], [3.1, 0.1])
    with pytest.raises(KeyError, match=r"a has no coordinate 0.25, nearest 0\.2"):
        table.sel(a=0.25)
    with pytest.raises(KeyError, match="no dimension named 'c'"):
        table.sel(c=1)
    with pytest.raises(KeyError, match="no values named 'total'"):
        table["total"]


def test_selection_has_tolerance():
    table = jb.sweep(lambda a: a, jb.grid(a=np.arange(-0.3, 0.35, 0.1)))
    assert abs(float(table.sel(a=0.0)["value"])) < 1e-15
    assert table.sel(a=slice(-0.1, 0.1))["value"].size == 3
    assert table.sel(a=[])["value"].size == 0
    for bad in ("x", None, True):
        with pytest.raises(TypeError, match="a must be selected by numbers"):
            table.sel(a=bad)
    with pytest.raises(ValueError, match="without step"):
        table.sel(a=slice(0, 1, 2))


def test_of_coordinates_that_are_close_the_nearest_is_selected():
    near, far = 1e9, 1e9 + 1
    table = jb.sweep(lambda a: a, jb.grid(a=[near, far, np.inf]))
    assert table.sel(a=near)["value"] == table.sel(a=near + 0.1)["value"] == near
    assert table.sel(a=far)["value"] == table.sel(a=far - 0.1)["value"] == far
    assert table.sel(a=np.inf)["value"] == np.inf
    assert table.sel(a=[far, near])["value"].tolist() == [far, near]
    listed = jb.sweep(lambda a: a, jb.points(a=[far, near, far]))
    assert listed.sel(a=far)["value"].tolist() == [far, far]


def test_labels_as_coordinates(tmp_path):
    which = jb.labels(in_plane=2, axial=1)
    table = jb.sweep(
        lambda a: a * jnp.arange(3.0), jb.grid(a=[1, 2]), dims={"value": {"mode": which}}
    )
    table.save(tmp_path / "t.npz")
    for t in (table, jb.Table.load(tmp_path / "t.npz")):
        np.testing.assert_array_equal(t.sel(mode=which[1])["value"], [1, 2])
        np.testing.assert_array_equal(t.sel(mode="axial 1", a=2)["value"], 4)
        assert t.sel(mode=[which[0], which[2]])["value"].shape == (2, 2)
    with pytest.raises(KeyError, match="mode has no coordinate 'flap bending 1'"):
        table.sel(mode=jb.models.Label(jb.models.Direction.FLAP, 1))


def test_explicit_list():
    table = jb.sweep(product, jb.points(a=[1, 2, 1], b=[5, 6, 7]))
    np.testing.assert_array_equal(table["sum"], [6, 8, 8])
    np.testing.assert_array_equal(table.sel(a=1)["b"], [5, 7])
    assert table.sel(case=1)["sum"] == 8


@pytest.mark.parametrize("result", ["array", "module"])
def test_other_results(result):
    class Out(eqx.Module):
        square: jnp.ndarray
        note: str = eqx.field(static=True, default="x")

    def f(a):
        return a**2 if result == "array" else Out(a**2)

    table = jb.sweep(f, jb.grid(a=[1, 2]))
    np.testing.assert_array_equal(table["value" if result == "array" else "square"], [1, 4])


def test_compiled_once():
    traces = 0

    def f(a):
        nonlocal traces
        traces += 1
        return a

    for n in (8, 8, 16):
        jb.sweep(f, jb.grid(a=np.arange(float(n))), chunk=8)
    assert traces == 1


MODEL = jb.Hybrid(4, 8, 0)
GRID = jb.grid(angular_speed=[1, 5, 60], hub_radius=[0.5, np.inf, 0], tip_mass=[0, 1, float("nan")])


def frequency(angular_speed, hub_radius, tip_mass, throw):
    rotor = jb.Rotor(slender(30.0).beam, hub_radius, tip_mass)
    found = jb.modes(MODEL, rotor, angular_speed, jb.labels(in_plane=2), throw=throw)
    return {"frequency": found.frequency, "status": found.status}


def returned(angular_speed, hub_radius, tip_mass):
    return frequency(angular_speed, hub_radius, tip_mass, throw=False)


def raised(angular_speed, hub_radius, tip_mass):
    return frequency(angular_speed, hub_radius, tip_mass, throw=True)


@pytest.mark.parametrize("chunk", [5, slow(27)])
@pytest.mark.parametrize("function", [returned, raised])
def test_failing_cases_leave_others_alone(function, chunk):
    table = jb.sweep(function, GRID, chunk=chunk)
    for i, speed in enumerate([1.0, 5.0, 60.0]):
        for j, hub in enumerate([0.5, np.inf, 0.0]):
            for k, tip in enumerate([0.0, 1.0, float("nan")]):
                status = jb.Status(int(table["status"][i, j, k]))
                message = table.take("angular_speed", [i]).take("hub_radius", [j])
                message = message.take("tip_mass", [k])
                got = message.errors.get(0, status.message)
                if hub == np.inf:
                    assert got == "hub_radius must be finite"
                elif np.isnan(tip):
                    assert got == "tip_mass must be finite and >= 0"
                elif speed == 60.0:  # the rod tears at 30 pi / 2 and below
                    assert got.startswith("no stable steady rotation at this angular_speed")
                else:
                    assert status is jb.Status.OK
                    alone = jb.modes(MODEL, slender(30.0, hub, tip), speed, jb.labels(in_plane=2))
                    np.testing.assert_allclose(
                        table["frequency"][i, j, k], alone.frequency, rtol=1e-12
                    )
                    continue
                assert np.isnan(table["frequency"][i, j, k]).all()
    assert table.message(angular_speed=1, hub_radius=np.inf, tip_mass=0) == (
        "hub_radius must be finite"
    )


def test_status_of_functions_without_one():
    table = jb.sweep(lambda a: {"x": 1 / a, "y": a}, jb.grid(a=[0, 1]))
    assert [jb.Status(s) for s in table["status"]] == [jb.Status.NOT_FINITE, jb.Status.OK]
    assert table["y"][0] == 0  # nothing is lost


def test_all_cases_raise():
    def f(a):
        return eqx.error_if(a, a > 0, "too large")

    with pytest.raises(RuntimeError, match="every case raised; the first one said: too large"):
        jb.sweep(f, jb.grid(a=[1, 2]))


def test_errors_of_the_function_itself_pass_through():
    traces = 0

    def broken(a):
        nonlocal traces
        traces += 1
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        jb.sweep(broken, jb.grid(a=np.arange(8.0)))
    assert traces == 1
    with pytest.raises(TypeError, match="unexpected keyword argument 'b'"):
        jb.sweep(lambda a: a, jb.grid(a=[1], b=[2]))
    with pytest.raises(TypeError, match="at least one array"):
        jb.sweep(lambda a: None, jb.grid(a=[1]))


def test_functions_that_are_swept_once_are_forgotten():
    """With their programs, when sixteen others have come; arrays bound to one are not another."""
    swept, traced = [], []

    def scaled(by, x, how):
        traced.append(type(how))
        return how * by * x

    def once(k):
        function = lambda x: x + k  # noqa: E731
        swept.append(weakref.ref(function))
        jb.sweep(function, {"x": [1.0]})

    def bound(by, how=2):
        function = jax.tree_util.Partial(scaled, jnp.asarray(by), how=how)
        return jb.sweep(function, {"x": [1.0]})["value"].item()

    for k in range(18):
        once(k)
    gc.collect()
    assert not any(function() for function in swept[:2])
    assert [bound(1.0), bound(3.0), bound(3.0, 2.0)] == [2.0, 6.0, 6.0]
    assert traced == [int, float]


def test_results_of_one_name_are_named():
    with pytest.raises(ValueError, match=r"two results of the swept function .* name 'a\.b'"):
        jb.sweep(lambda x: {"a": {"b": x}, "a.b": 2 * x}, {"x": [1.0]})


def test_a_sweep_that_is_traced_says_what_to_do():
    def total(function, x):
        return jnp.sum(jb.sweep(function, {"x": x})["value"])

    def product(a, x):
        return a * x

    for traced in (
        lambda a: total(jax.tree_util.Partial(product, a), [1.0, 2.0]),
        lambda a: total(lambda x: a * x, [1.0, 2.0]),
        lambda a: total(lambda x: x, [a, 2 * a]),
        lambda a: total(lambda x: x, a * jnp.ones(2)),
    ):
        for transformed in (jax.grad(traced), jax.jit(traced)):
            with pytest.raises(TypeError, match=r"^a sweep cannot be inside jax.grad.*its place"):
                transformed(2.0)


def test_a_status_of_another_version_is_named():
    table = jb.Table({"status": np.array(999)}, {"status": ()}, {})
    with pytest.raises(ValueError, match="message: 999 is no status that this version knows"):
        table.message()


def test_bad_arguments():
    with pytest.raises(ValueError, match="a must be one-dimensional and not empty"):
        jb.grid(a=[])
    with pytest.raises(ValueError, match="a must be one-dimensional"):
        jb.points(a=1.0)
    with pytest.raises(TypeError, match="a must be real floating-point numbers, got int64"):
        jb.grid(a=np.arange(3))
    with pytest.raises(TypeError, match="a must be real floating-point numbers, got complex"):
        jb.grid(a=[1j])
    with pytest.raises(ValueError, match="equally long"):
        jb.points(a=[1.0], b=[1.0, 2.0])
    with pytest.raises(ValueError, match="name at least one parameter"):
        jb.grid()
    for bad in (0, 2.0, True):
        with pytest.raises(ValueError, match="chunk must be an int >= 1"):
            jb.sweep(lambda a: a, jb.grid(a=[1]), chunk=bad)
    with pytest.raises(ValueError, match="no results named"):
        jb.sweep(lambda a: a, jb.grid(a=[1]), dims={"x": {"y": [1]}})
    with pytest.raises(ValueError, match="a must not repeat values in a grid"):
        jb.grid(a=[1, 1])
    with pytest.raises(ValueError, match="share the names"):
        jb.sweep(lambda a: {"a": a}, jb.points(a=[1]))
    with pytest.raises(ValueError, match="status is the name"):
        jb.points(status=[1])
    with pytest.raises(ValueError, match="status of a result must be an integer"):
        jb.sweep(lambda a: {"x": a, "status": a}, jb.points(a=[1]))
    with pytest.raises(ValueError, match="two different sets of coordinates for 'a'"):
        jb.sweep(product, jb.grid(a=[1, 2], b=[1]), dims={"pair": {"a": ["x", "y"]}})
    with pytest.raises(ValueError, match="further dimensions"):
        jb.sweep(product, jb.grid(a=[1], b=[1]), dims={"pair": {"which": ["a"]}})


@pytest.fixture
def table():
    return jb.sweep(returned, GRID, dims={"frequency": {"mode": ["first", "second"]}})


def test_save_and_load(table, tmp_path):
    raising = jb.sweep(raised, GRID)
    for original in (table, raising):
        original.save(tmp_path / "table.npz")
        loaded = jb.Table.load(tmp_path / "table.npz")
        assert loaded.dims == original.dims
        assert loaded.errors == original.errors
        assert loaded.values.keys() == original.values.keys()
        for name, value in original.values.items():
            np.testing.assert_array_equal(loaded[name], value)
        for name, coordinate in original.coords.items():
            np.testing.assert_array_equal(loaded.coords[name], coordinate)


def test_csv(table, tmp_path):
    table.to_csv(tmp_path / "table.csv")
    rows = np.genfromtxt(tmp_path / "table.csv", delimiter=",", names=True, deletechars="")
    assert len(rows) == 27
    for row in rows[:6]:
        if np.isnan(row["tip_mass"]):
            continue
        at = {n: row[n] for n in ("angular_speed", "hub_radius", "tip_mass")}
        expected = table.sel(**at, mode="first")["frequency"]
        np.testing.assert_array_equal(row["frequency[first]"], expected)
    complex_table = jb.sweep(product, jb.points(a=[1, 2], b=[3, 4]))
    complex_table.to_csv(tmp_path / "c.csv")
    header = (tmp_path / "c.csv").read_text().splitlines()[0]
    assert header == "case,a,b,pair[0],pair[1],sum,wave.real,wave.imag,status"


def test_xarray(table, monkeypatch):
    dataset = table.to_xarray()
    picked = dataset["frequency"].sel(angular_speed=5, hub_radius=0.5, tip_mass=1, mode="second")
    assert float(picked) == table["frequency"][1, 0, 1, 1]
    original = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "xarray":
            raise ImportError
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match="pip install xarray"):
        table.to_xarray()


def test_progress(capsys):
    jb.sweep(lambda a: a, jb.grid(a=np.arange(5.0)), progress=True, chunk=2)
    assert "5/5 cases" in capsys.readouterr().err
    jb.sweep(lambda a: a, jb.grid(a=np.arange(5.0)))
    assert capsys.readouterr().err == ""
    jb.sweep(lambda a: a, jb.grid(a=np.arange(5.0)), progress=False)
    assert capsys.readouterr().err == ""
