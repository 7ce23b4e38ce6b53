"""Mistakes that are plain from numbers that are known are told before anything is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import Status
from jaxbeam._programs.program import Program

BEAM = jb.Beam(10.0, 20.0, 1e8, 1e6, 4e5, torsional_stiffness=3e5, polar_inertia=1.0)
ROTOR, TIMES = jb.Rotor(BEAM, 0.5), np.linspace(0.0, 1.0, 3)
LINEAR, PLANAR, SPACE = jb.Hybrid(0, 4, 4), jb.PlanarRod(2), jb.SpatialRod(2)
LABEL, TURNING = jb.labels(in_plane=1)[0], jb.ConstantSpeed(1.0)
ACROSS, DOWN = jb.Loads(gravity=[0.0, -9.8, 0.0]), jb.Loads(gravity=[0.0, 0.0, -9.8])
ASIDE, OUT = jb.Loads(tip_force=[0.0, 1.0, 0.0]), jb.Loads(tip_force=[0.0, 0.0, 1.0])
ALONG = jb.Loads(force_per_length=(0.0, 1.0, 1.0))
PLACES = [0.25, 0.5, 0.75]
BALANCED = jb.Loads(point_forces=jb.PointForces(PLACES, [[0, 1, 5], [0, 1, -10], [0, 1, 5]]))
THRUST = jb.Loads(tip_force=[-1.0, 0.0, 0.0], follows=True)
NOWHERE = jb.solvers.State(jnp.full(9, jnp.nan), jnp.zeros(9))

MISTAKES = {
    "modes": (lambda: jb.modes(LINEAR, ROTOR, 3.0, 2, loads=ACROSS), Status.TURNING_GRAVITY),
    "modes in space": (lambda: jb.modes(SPACE, ROTOR, 3.0, 2, loads=ACROSS),
                       Status.TURNING_GRAVITY),
    "modes in plane": (lambda: jb.modes(PLANAR, ROTOR, 0.0, 2, loads=OUT), Status.OUT_OF_PLANE),
    "along": (lambda: jb.modes(PLANAR, ROTOR, 0.0, 2, loads=ALONG), Status.OUT_OF_PLANE),
    "points": (lambda: jb.steady(PLANAR, ROTOR, 0.0, loads=BALANCED), Status.OUT_OF_PLANE),
    "points aside": (lambda: jb.critical_load(LINEAR, ROTOR, BALANCED), Status.LOADS_ACROSS),
    "southwell": (lambda: jb.southwell(LINEAR, ROTOR, 0.0, 2, loads=ACROSS),
                  Status.TURNING_GRAVITY),
    "crossing": (lambda: jb.crossing(LINEAR, ROTOR, (1.0, 2.0), LABEL, 1.0, loads=ACROSS),
                 Status.TURNING_GRAVITY),
    "critical_speed": (lambda: jb.critical_speed(SPACE, ROTOR, loads=ACROSS),
                       Status.TURNING_GRAVITY),
    "critical_load": (lambda: jb.critical_load(LINEAR, ROTOR, ASIDE), Status.LOADS_ACROSS),
    "follows": (lambda: jb.critical_load(SPACE, ROTOR, THRUST, 2.0), Status.NO_POTENTIAL),
    "simulate": (lambda: jb.simulate(PLANAR, ROTOR, TURNING, TIMES, loads=OUT),
                 Status.OUT_OF_PLANE),
    "falls": (lambda: jb.simulate(PLANAR, ROTOR, TURNING, TIMES, loads=DOWN),
              Status.OUT_OF_PLANE),
    "start": (lambda: jb.simulate(PLANAR, ROTOR, TURNING, TIMES, start=NOWHERE),
              Status.INVALID_START),
    "dt0": (lambda: jb.simulate(PLANAR, ROTOR, TURNING, TIMES, dt0=-1.0), Status.INVALID_TIMES),
    "steady_start": (lambda: jb.steady_start(PLANAR, ROTOR, TURNING, loads=OUT),
                     Status.OUT_OF_PLANE),
    "history": (lambda: jb.fitting.HistoryData(PLANAR, ROTOR, TURNING, TIMES, np.zeros(3), 1.0,
                                               lambda run: run.tip[:, 1], loads=OUT),
                Status.OUT_OF_PLANE),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_plain_mistake_is_told_before_anything_is_compiled(mistake, monkeypatch):
    def compiled(*_, **__):
        raise AssertionError("compiled before the mistake was told")

    monkeypatch.setattr(Program, "__call__", compiled)
    call, status = MISTAKES[mistake]
    with pytest.raises(ValueError, match="^" + status.message[:40].replace("(", r"\(")):
        call()


@pytest.mark.exhaustive
def test_without_raising_or_with_traced_numbers_there_is_a_status():
    """As of a batch: good cases are left alone."""
    small = jb.Hybrid(0, 3, 3)
    found = jb.modes(small, ROTOR, 3.0, 2, loads=ACROSS, throw=False)
    assert found.status == Status.TURNING_GRAVITY
    assert np.isnan(found.frequency).all()
    found = jb.critical_load(small, ROTOR, ASIDE, throw=False)
    assert found.status == Status.LOADS_ACROSS
    run = jb.simulate(PLANAR, ROTOR, TURNING, TIMES, loads=OUT, throw=False)
    assert run.status == Status.OUT_OF_PLANE

    @jax.jit
    @jax.vmap
    def of(gravity):
        return jb.modes(small, ROTOR, 3.0, 2, loads=jb.Loads(gravity=gravity), throw=False).status

    both = of(jnp.array([[0.0, 0.0, -9.8], [0.0, -9.8, 0.0]]))
    assert both.tolist() == [Status.OK, Status.TURNING_GRAVITY]


@pytest.mark.exhaustive
def test_what_is_no_mistake_is_let_through():
    """Gravity across a beam at rest, and along the axis of one that turns; in space all."""
    jb.modes(LINEAR, ROTOR, 0.0, 2, loads=ACROSS)
    jb.modes(LINEAR, ROTOR, 3.0, 2, loads=DOWN)
    jb.modes(SPACE, ROTOR, 0.0, 2, loads=OUT)
    still = jb.motions.HubPose(lambda t: jnp.zeros(3), lambda t: jnp.eye(3))
    jb.simulate(PLANAR, ROTOR, still, TIMES, loads=ACROSS)
