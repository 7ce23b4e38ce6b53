"""Shapes of modes: displacements, polynomials, and files of blades with them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._results import found_alone
from jaxbeam.blades import SpanwiseFunction, read_blade, write_elastodyn
from jaxbeam.results import Modes

UNIFORM = jb.Rotor(jb.Beam(2.0, 3.0, 1e7, 50.0, 20.0))
MODEL = jb.Hybrid(0, 8, 8)
WHICH = jb.labels(flap=2, in_plane=1)
ROOTS = np.array([1.8751040687119611, 4.694091132974174])
XI = np.linspace(0.0, 1.0, 21)


def cantilever(root, xi):
    """The function of a clamped and free beam, one at its tip."""
    c = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
    x = root * xi
    value = np.cosh(x) - np.cos(x) - c * (np.sinh(x) - np.sin(x))
    return value / (np.cosh(root) - np.cos(root) - c * (np.sinh(root) - np.sin(root)))


@jax.jit
def of(speed, rotor=UNIFORM):
    return jb.modes(MODEL, rotor, speed, WHICH, throw=False)


def test_displacements_are_those_of_a_cantilever():
    found = of(0.0)
    u = found.displacement(XI, tip=True)
    exact = np.stack([cantilever(root, XI) for root in (*ROOTS, ROOTS[0])])
    np.testing.assert_allclose(u[:2, :, 2], exact[:2], atol=1e-4)
    np.testing.assert_allclose(u[0, :, 2], exact[0], atol=1e-8)
    np.testing.assert_allclose(u[2, :, 1], exact[2], atol=1e-9)
    assert not np.any(u[:2, :, :2])
    # Of unit modal mass: the mean of phi^2 is a quarter of its square at the tip.
    np.testing.assert_allclose(np.abs(found.displacement()[2, 0, 1]), 2 / np.sqrt(6.0), rtol=1e-9)
    assert not np.any(found.torsion(XI))


def test_polynomials_are_the_least_squares_fit_and_say_how_far_they_are_off():
    fits = of(0.0).polynomials()
    x = (1 - np.cos(np.linspace(0, np.pi, 4001))) / 2
    weight = np.gradient(x)
    for row, misfit, root in zip(*fits, (*ROOTS, ROOTS[0]), strict=True):
        rows, exact = x[:, None] ** np.arange(2, 7), cantilever(root, x)
        own, *_ = np.linalg.lstsq(np.sqrt(weight)[:, None] * rows, np.sqrt(weight) * exact)
        np.testing.assert_allclose(row, own / own.sum(), rtol=4e-3)
        np.testing.assert_allclose(row.sum(), 1.0, rtol=1e-12)
        off = np.abs(rows @ own - exact).max()
        assert 0.5 * off < misfit < 1.1 * off
    assert fits.misfit[0] < 1e-4 < fits.misfit[1] < 1e-2


@pytest.mark.slow
def test_shapes_of_a_batch_and_under_jit():
    speeds = jnp.array([0.0, 3.0])
    many = jax.jit(jax.vmap(of))(speeds)
    for found, alone in (
        (many.polynomials().coefficients, lambda m: m.polynomials().coefficients),
        (many.displacement(XI, tip=True), lambda m: m.displacement(XI, tip=True)),
    ):
        one = jax.jit(lambda w: alone(of(w)))(3.0)  # noqa: B023
        np.testing.assert_allclose(found[1], one, atol=1e-9)


def test_modes_know_their_rotor_in_batches_too():
    """Beams that vary, from case to case: of each the shapes are functions of its own."""

    def case(root):
        stiffness = jb.Spanwise([0.0, 1.0], jnp.stack([root, 20.0]))
        rotor = jb.Rotor(jb.Beam(2.0, 3.0, 1e7, 50.0, stiffness))
        one = jnp.ones(1)
        fields = one + 0j, one[None] + 0j, 2 * one.astype(int), one, one[None], one
        status = jnp.where(root > 0, 0, 1)
        return Modes(*fields, status, one[0], model=jb.Hybrid(0, 0, 1), rotor=rotor)

    @jax.jit
    def asked(roots):
        inside = jax.vmap(lambda root: case(root).displacement(XI))(roots)
        many = jax.vmap(case)(roots)
        return inside, many.displacement(XI), jax.vmap(lambda m: m.displacement(XI))(many)

    inside, outside, one_by_one = asked(jnp.array([20.0, 900.0, jnp.nan]))
    np.testing.assert_allclose(outside, inside, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(one_by_one, inside, rtol=1e-12, atol=1e-14)
    assert np.isnan(outside[2]).all()
    shape = np.abs(outside[:2, 0, :, 2])
    assert np.ptp(shape[:, 10] / shape[:, -1]) > 0.02


def test_a_rotor_is_not_asked_for_twice():
    found = of(0.0)
    for ask in (
        lambda: found.torsion(UNIFORM, XI), lambda: found.displacement(UNIFORM),
        lambda: found.displacement(xi=XI, rotor=UNIFORM), lambda: found.polynomials(UNIFORM),
    ):  # fmt: skip
        with pytest.raises(TypeError):
            ask()


def test_what_modes_are_asked_with_is_no_column_of_a_table():
    found = found_alone({"found": of(0.0), "more": jnp.ones(2)})
    assert found["found"].rotor is None
    assert jax.tree.structure(found_alone(found)) == jax.tree.structure(found)
    table = jb.sweep(lambda w: {"found": of(w)}, jb.grid(w=[0.0, 1.0]))
    assert {name.rpartition(".")[2] for name in table} == {
        "eigenvalue", "shape", "direction", "number", "energy_share", "residual", "status",
        "steady_strain", "frequency_error",
    }  # fmt: skip


def test_polynomials_are_differentiable_and_a_case_that_failed_has_none():
    """The more a blade turns the more its first mode is a straight line."""

    def last(speed):
        return of(speed).polynomials().coefficients[0, 0]

    rate, step = jax.jit(jax.grad(last))(3.0), 1e-4
    np.testing.assert_allclose(rate, (last(3 + step) - last(3 - step)) / (2 * step), rtol=1e-5)
    failed = of(jnp.nan)
    assert np.all(np.isnan(failed.polynomials().misfit))
    assert np.all(np.isnan(failed.displacement(XI, tip=True)))


TWIST = jb.Spanwise([0.0, 0.4, 1.0], [0.6, 0.2, 0.0])
BLADE = jb.Beam(
    2.0, jb.Spanwise([0, 0.3, 0.3, 1], [3.0, 3.0, 2.0, 0.5]), 1e7,
    SpanwiseFunction(lambda xi: 900.0 - 700.0 * xi), jb.Spanwise([0, 1], [20.0, 4.0]), twist=TWIST,
)  # fmt: skip


@pytest.mark.slow
def test_with_twist_the_deflection_is_what_the_shape_does_to_turned_sections():
    """int int p'' (cos, -sin)(twist), as ElastoDyn adds it up, by the trapezoidal rule."""
    rotor = jb.Rotor(BLADE, 0.3)
    x = np.linspace(0.0, 1.0, 4001)

    @jax.jit
    def shapes(speed):
        found = jb.modes(jb.Hybrid(0, 10, 10), rotor, speed, WHICH, throw=False)
        return found.polynomials(), found.displacement(x).real

    (rows, misfit), u = shapes(1.0)
    angle = np.interp(x, TWIST.stations, TWIST.values)

    def twice(curvature):
        for _ in range(2):
            parts = (curvature[1:] + curvature[:-1]) / 2 * np.diff(x)
            curvature = np.append(0.0, np.cumsum(parts))
        return curvature

    for i, (own, across, sign) in enumerate(((2, 1, -1.0), (2, 1, -1.0), (1, 2, 1.0))):
        curvature = sum(k * (k - 1) * c * x ** (k - 2) for k, c in enumerate(rows[i], 2))
        wanted = np.concatenate([u[i, :, own], u[i, :, across]])
        there = np.concatenate(
            [twice(curvature * np.cos(angle)), sign * twice(curvature * np.sin(angle))]
        )
        scale = there @ wanted / (there @ there)
        off = np.abs(scale * there - wanted).max() / np.abs(wanted).max()
        np.testing.assert_allclose(misfit[i], off, rtol=0.3, atol=1e-4)
    # The first mode hardly bends sections about their stiff axis, so that one shape does for both.
    assert misfit[0] < 0.02


def test_a_file_that_is_written_reads_as_the_same_beam(tmp_path):
    rows = np.array([[0.5, 0.7, -0.2, 0.1, -0.1], [-0.6, -1.2, 4.0, -2.0, 0.8]])
    edge = np.array([0.9, 0.3, -0.3, 0.2, -0.1])
    path = tmp_path / "blade.dat"
    write_elastodyn(path, BLADE, flap=rows, edge=edge, damping=(0.005, 0.006, 0.007))
    read = read_blade(path, length=2.0, axial_stiffness=1e7)
    xi = np.array([0.0, 0.1, 0.299999, 0.300001, 0.44, 0.9, 1.0])
    for name in (
        "mass_per_length",
        "in_plane_bending_stiffness",
        "flap_bending_stiffness",
        "twist",
    ):
        values = (getattr(beam, name).at(xi) for beam in (read.beam, BLADE))
        np.testing.assert_allclose(*values, rtol=1e-8, atol=1e-12)
    said = dict(reversed(line.split()[:2]) for line in path.read_text().splitlines()[3:] if line)
    for name, row in (("BldFl1Sh", rows[0]), ("BldFl2Sh", rows[1]), ("BldEdgSh", edge)):
        there = [float(said[f"{name}({k})"]) for k in range(2, 7)]
        np.testing.assert_allclose(there, row, rtol=1e-11)
    assert [said[f"Bld{n}"] for n in ("FlDmp(1)", "FlDmp(2)", "EdDmp(1)")] == ["0.5", "0.6", "0.7"]
    assert said["NBlInpSt"] == str(len(read.beam.mass_per_length.stations))
    assert np.all(np.diff(read.beam.twist.stations) > 0)


@pytest.mark.parametrize(
    ("stations", "also", "written"),
    [
        ([0.0, 0.3, 0.3, 1.0], 0.1 + 0.2, "0 0.3 0.300000001 1"),
        ([0.0, 0.3, 1.0], 0.1 + 0.2, "0 0.3 1"),
        ([0.0, 0.3, 0.3, 0.3 + 5e-10, 1.0], 0.3, "0 0.3 0.300000001 1"),
        ([0.0, 0.3, 1.0], 1 - 1e-10, "0 0.3 0.999999999 1"),
        ([0.0, 0.3, 1.0], 1e-10, "0 1e-09 0.3 1"),
    ],
)
def test_stations_that_differ_by_rounding_are_written_once(stations, also, written, tmp_path):
    """And those at a step beside it: all of them increase, and the beam is the same."""
    values = np.geomspace(300.0, 10.0, len(stations))
    beam = jb.Beam(
        50.0, jb.Spanwise(stations, values), 1e9, 1e9, 1e9,
        twist=jb.Spanwise([0.0, also, 1.0], [0.2, 0.1, 0.0]),
    )  # fmt: skip
    path, row = tmp_path / "blade.dat", [1.0, 0.0, 0.0, 0.0, 0.0]
    write_elastodyn(path, beam, flap=[row, row], edge=row)
    lines = path.read_text().splitlines()
    first = lines.index("(-) (-) (deg) (kg/m) (Nm^2) (Nm^2)") + 1
    count = len(written.split())
    assert " ".join(line.split()[0] for line in lines[first : first + count]) == written
    read = read_blade(path, length=50.0, axial_stiffness=1e9).beam
    xi = np.array([0.0, 2e-8, 0.1, 0.29999999, 0.30000001, 0.9, 1.0 - 2e-8, 1.0])
    for name in ("mass_per_length", "twist"):
        there, wanted = (getattr(b, name).at(xi) for b in (read, beam))
        np.testing.assert_allclose(there, wanted, rtol=1e-7, atol=1e-8)


def test_what_cannot_be_written_is_said(tmp_path):
    good = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    path, beam = tmp_path / "blade.dat", UNIFORM.beam

    def write(beam=beam, flap=(good, good), edge=good, **more):
        write_elastodyn(path, beam, flap=flap, edge=edge, **more)

    for error, text, call in (
        (ValueError, "BldEdgSh must sum to one, got 2", lambda: write(edge=2 * good)),
        (ValueError, "BldFl2Sh must be five", lambda: write(flap=(good, good[:4]))),
        (ValueError, "must sum to one, got nan", lambda: write(edge=np.nan * good)),
        (ValueError, "two modes, got 1", lambda: write(flap=[good])),
        (
            TypeError,
            "flap must be the coefficients of two modes, got None",
            lambda: write(flap=None),
        ),
        (ValueError, "damping must be three", lambda: write(damping=(1.0,))),
        (TypeError, "beam must be a Beam", lambda: write(beam=UNIFORM)),
        (TypeError, "beam must be known", lambda: jax.jit(lambda b: write(beam=b))(beam)),
        (
            ValueError, "rotor.pitch must be None .* take the modes of the rotor without its pitch",
            lambda: of(0.0, jb.Rotor(beam, pitch=0.1)).polynomials(),
        ),
        (ValueError, "xi must be x / L", lambda: of(0.0).displacement(1.5)),
    ):  # fmt: skip
        with pytest.raises(error, match=text):
            call()
    assert not path.exists()
    write(title="BlFract BMassDen")  # as the titles of columns
    np.testing.assert_allclose(
        read_blade(path, length=2.0, axial_stiffness=1e7).beam.mass_per_length.at(XI), 3.0
    )
