"""Beams in space in time: cones, films, and what leaves the range of its polynomials."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxbeam as jb
from jaxbeam import plot
from tests.beams import TORSION, short
from tests.helpers import optimised, run_optimised

MODEL = jb.SpatialRod(2)
BLADE = short(**TORSION)
CONED = jb.Rotor(BLADE, hub_radius=0.4, tip_mass=0.3, precone=0.3, pitch=0.2)
AXIS = jb.motions.inclined_axis(1.1)


def turning(t):
    return jnp.array([0.4, 0.2, -0.3]) * t


@pytest.mark.exhaustive
def test_jacobi_integral_of_large_motion():
    """Over a hundred periods of the first mode, in a cone, about an inclined axis, let go where a
    force across has bent it both ways. A beam that is not too slender: what counts is the number of
    steps."""
    rotor = jb.Rotor(short(4e3, **TORSION), hub_radius=0.4, tip_mass=0.3, precone=0.3)
    end = 200 * np.pi / float(jb.modes(MODEL, rotor, 0.0, 1).frequency[0])
    motion = jb.ConstantSpeed(1.0, AXIS)
    start = jb.steady_start(MODEL, rotor, motion, loads=jb.Loads(tip_force=[0.0, -0.6, 0.5]))
    run = optimised(
        lambda: jb.simulate(
            MODEL, rotor, motion, np.linspace(0, end, 101), start=start, max_steps=10**6,
            stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-11),
        )
    )()  # fmt: skip
    assert np.abs(run.tip[0, 1:]).min() > 0.1
    h = run.jacobi_integral
    assert np.abs(h - h[0]).max() < 1e-8 * np.abs(run.strain_energy).max()


@pytest.mark.exhaustive
def test_one_case_that_leaves_the_range_does_not_spoil_its_neighbours():
    """Loads are functions of time that close over a number of their case. The force of the second
    bends it by far; the third has no stiffness in torsion."""
    times = jnp.linspace(0.0, 0.5, 6)

    def run(size, torsion):
        beam = short(torsional_stiffness=torsion, polar_inertia=0.03)
        loads = jb.Loads(
            tip_force=lambda t: size * jnp.array([-1.0, 0.1, 0.1]) * jnp.minimum(20 * t, 1.0),
            tip_moment=lambda t: size * 0.1 * turning(t), changes=[0.05],
        )  # fmt: skip
        return jb.simulate(
            MODEL, jb.Rotor(beam), jb.SmoothSpinUp(2.0, 0.5, AXIS), times, loads=loads, throw=False
        )

    batch = optimised(jax.vmap(run))(jnp.array([1.0, 100.0, 1.0, 2.0]), jnp.array([6, 6, -1.0, 6]))
    assert list(map(jb.Status, batch.status.tolist())) == [
        jb.Status.OK, jb.Status.OUT_OF_RANGE, jb.Status.INVALID_TORSIONAL_STIFFNESS, jb.Status.OK
    ]  # fmt: skip
    one = optimised(run)
    for k, size in ((0, 1.0), (3, 2.0)):
        alone = one(jnp.asarray(size), jnp.asarray(6.0))
        np.testing.assert_allclose(batch.tip[k], alone.tip, rtol=0, atol=1e-8)


@pytest.mark.exhaustive
def test_what_it_costs_to_leave_a_cone_out():
    """What docs/limitations.md says of the beam of B Ref. 21: lag by some two fifths of the square
    of the cone, and all of its sinking towards the plane of rotation."""
    beam = jb.Beam(8.0, 0.202, 5.033e6, 566.4, 566.4, torsional_stiffness=430.0)
    cone = jnp.deg2rad(jnp.array([0.0, 2.0, 5.0, 10.0]))

    def spin_up(cone, speed):
        run = jb.simulate(
            jb.SpatialRod(4), jb.Rotor(beam, 0.5, 0.1, precone=cone),
            jb.SmoothSpinUp(speed, 15.0), jnp.linspace(0.0, 16.0, 81), max_steps=20_000,
        )  # fmt: skip
        return run.tip

    for speed, lags, sunk in (
        (2.0, (5e-4, 3.3e-3, 1.3e-2), 0.40),
        (4.0, (7e-4, 4.4e-3, 1.7e-2), 0.7),
    ):
        tip = np.asarray(jax.jit(jax.vmap(spin_up, (0, None)))(cone, speed))
        lag = np.abs(tip[1:, :, 1]).max(1)
        off = np.abs(tip[1:, :, 1] - tip[0, :, 1]).max(1) / lag
        np.testing.assert_allclose(off, lags, rtol=0.15)
        height = 8.0 * np.sin(cone[1:])
        np.testing.assert_allclose(-tip[1:, :, 2].min(1) / height, sunk, rtol=0.03)


@pytest.mark.exhaustive
def test_films_show_where_the_beam_is(tmp_path):
    """Faces of ribbons are those of displacement, in axes of the hub and in space."""
    times = jnp.linspace(0.0, 0.2, 3)
    run = jb.simulate(MODEL, CONED, jb.SmoothSpinUp(2.0, 0.5, AXIS), times)
    strip = plot.filmstrip(run, frames=2)
    hub, space = strip.axes[:2]
    assert (hub.get_title(), space.get_title()) == ("axes of the hub", "space")
    tips = [np.stack(ax.lines[-1].get_data_3d(), 1) for ax in (hub, space)]
    out = 2.0 * np.array([np.cos(0.3), 0.0, np.sin(0.3)]) + [0.4, 0, 0]
    np.testing.assert_allclose(tips[0], np.asarray(run.tip) + out, rtol=0, atol=1e-14)
    turn = jax.vmap(run.scene.motion.attitude)(times)
    np.testing.assert_allclose(tips[1], np.einsum("tij,tj->ti", turn, tips[0]), atol=1e-14)
    plot.film(run, Figure()).save(tmp_path / "film.gif", "pillow", dpi=20)
    assert (tmp_path / "film.gif").stat().st_size > 0
    with pytest.raises(ValueError, match="run must be that of one case"):
        plot.filmstrip(eqx.tree_at(lambda r: r.times, run, run.times[None]))


ALONE = """
import jax
import jax.numpy as jnp
import jaxbeam as jb

jax.config.update("jax_enable_x64", True)
beam = jb.Beam(2.0, 1.3, 4e4, 11.0, 7.0, torsional_stiffness=5.0)


def end(radius):
    rotor = jb.Rotor(beam, radius, 0.3)
    run = jb.simulate(jb.SpatialRod(3), rotor, jb.SmoothSpinUp(2.0, 1.0), jnp.linspace(0, 1, 3))
    return jnp.sum(run.tip[-1])


print(jax.grad(end)(0.4), (end(0.401) - end(0.399)) / 2e-3)
"""


@pytest.mark.exhaustive
def test_gradient_by_one_number_alone():
    """All else is a constant of the program, which XLA moves into functions that are compiled as
    one: it must not end the process over operands that nothing uses any more."""
    gradient, slope = map(float, run_optimised("-c", ALONE).split())
    np.testing.assert_allclose(gradient, slope, rtol=1e-4)


ONE, PLAIN = jb.SpatialRod(2), jb.Beam(1.0, 1.0, 1e4, 1.0, 0.5, torsional_stiffness=0.7)


def bent(moment, **more):
    """Axial displacement of the tip of one element under a moment in the plane, 0 where there is no
    steady state, and the status."""
    loads = jb.Loads(tip_moment=jnp.stack([0 * moment, 0 * moment, moment]))
    found = jb.steady(ONE, jb.Rotor(PLAIN, **more), 0.0, loads=loads, throw=False)
    return jnp.where(found.status == jb.Status.OK, found.tip[0], 0.0), found.status


FOLDING = jnp.array([1.0, 5.5, 20.0, 30.0, 50.0, 100.0])


@pytest.mark.slow
def test_what_turns_within_an_element_by_more_than_its_polynomials_follow():
    """A moment bends it to an arc: through a radian that is fine, through more than five it is out
    of range, and where there would be loops no state is given out."""
    _, status = jax.jit(jax.vmap(bent))(FOLDING)
    assert status[0] == jb.Status.OK
    assert (status[1:] != jb.Status.OK).all()
    assert status[1] == jb.Status.OUT_OF_RANGE


@pytest.mark.slow
def test_failed_cases_do_not_spoil_what_cases_share_through_displacements_in_a_cone():
    def tips(cone, moments):
        found, status = jax.vmap(lambda moment: bent(moment, precone=cone))(moments)
        return jnp.sum(found), status

    gradient = jax.jit(jax.grad(tips, has_aux=True))
    alone, status = gradient(0.1, jnp.full(6, 1.0))
    assert (status == jb.Status.OK).all()
    among, status = gradient(0.1, FOLDING)
    assert ((status == jb.Status.OK) == (FOLDING == 1.0)).all()
    np.testing.assert_allclose(among, alone / 6, rtol=1e-12)


@pytest.mark.slow
def test_what_leaves_its_range_between_outputs_is_told():
    def pulse(t):
        return jnp.stack([0 * t, 0 * t, 4 * jnp.exp(-(((t - 0.4) / 0.1) ** 2))])

    run = jb.simulate(
        ONE, jb.Rotor(PLAIN, tip_mass=0.2), jb.ConstantSpeed(0.0), [0.0, 3.0],
        loads=jb.Loads(tip_moment=pulse), damping=jb.Damping(mass_coefficient=3.0), throw=False,
    )  # fmt: skip
    assert run.status == jb.Status.OUT_OF_RANGE
