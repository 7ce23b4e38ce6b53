"""What motion and loads do along a run, and steps that follow it.

A solver sees the hub only at the stages of its steps, and at rest nothing limits a step: it would
leap over a motion that begins later. So every run looks at its motion and loads beforehand, at
`SAMPLES` times, and bounds each step by the shortest event that it could pass over; steps end at
the times of change and of jumps that are declared; and in every step the change of the hub's speed
is compared with the integral of its rate, by which a step that missed something is made anew, and
a jump is found.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._results import without_derivatives
from jaxbeam._rotor.clock import place
from jaxbeam._rotor.motion import Hub
from jaxbeam._simulation.checks import Seen
from jaxbeam._simulation.pauses import Pauses
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._types import Matrix, Scalar

SAMPLES = 1024  # number of intervals between samples of motion and loads in a run
# Threshold of the change within a stride that error control might not see: a pulse as long as a
# stride has 1.4, of two strides 0.5, of three 0.3, a smooth signal 0.12.
_UNSEEN = 0.3
# Step, in tenths of a radian of the first mode, while the beam is at rest: errors of states are
# then zero for any step, but those of derivatives are not. Not used where it needs more steps than
# there are samples.
_AT_REST = 2.5
_LAST = 4  # number of steps before a stop that an adaptive controller makes of equal length
_LONGER = 0.05  # share of a step by which these together may be longer
# Time, in tenths of a radian of the first mode, in which the beam hardly moves.
_QUICK = 10.0
_STILL = 1e-9  # displacements over the length below this count as zero
_FLOOR = 1e-6  # changes, over the largest value, below this do not count
# Direction along which three components are looked at as one signal: no motion of interest is
# normal to it.
_ASLANT = np.array([0.48, 0.6, 0.64])


def during(times: Array, parts: int = 64) -> Array:
    """Times all along a run, independent of its output times, at which motion and loads are
    sampled."""
    share = np.linspace(0.0, 1.0, parts + 1)
    return times[0] * (1 - share) + times[-1] * share  # without rounding at both ends


class StepLimits(eqx.Module):
    """Limits of steps, and the largest speeds of the hub; without derivatives."""

    rounding: Scalar  # rounding of times by the clock of motion and loads, s
    spacing: Scalar  # spacing of the samples, s
    longest_step: Float[Array, "64 3"]  # longest step in each cell, as of `_longest_step`
    pauses: Pauses  # declared times at which steps end
    at_rest: Scalar  # longest step while the beam is still at rest, s
    quick: Scalar  # between declared times closer than this the beam hardly moves, s
    velocities: Float[Array, " 6"]  # velocities of the hub at the start, after a jump there, m/s
    speed: Scalar  # largest velocity of the hub, m/s
    measure: Matrix | None  # see `Equations.velocity_measure`

    def __init__(self, scene: Scene, times: Array, seen: Seen, moment: Scalar) -> None:
        """`scene` counts time since the first of `times`; `seen` is what acts at `SAMPLES` + 1
        times `during` the run, and in a `moment` the first mode moves by a tenth of a radian."""
        scene, times, (hub, force, span) = without_derivatives((scene, times, seen))
        self.spacing = (times[-1] - times[0]) / SAMPLES
        self.rounding = 8 * jnp.finfo(times.dtype).eps * jnp.max(jnp.abs(times))
        velocities, signals = jax.vmap(scene.velocities_of)(hub), _signals(hub, force, span)
        self.pauses, self.measure = scene.pauses, scene.equations.velocity_measure()
        # Together, since `jnp.max` of each one separately takes programs of its own to compile.
        sizes = jnp.stack([jnp.max(jnp.abs(velocities), 1), *jnp.abs(signals)])
        self.speed, *largest = jnp.max(sizes, 1)
        signals = signals / jnp.stack([jnp.where(top > 0, top, 1.0) for top in largest])[:, None]
        # A velocity that changes by more than its rate explains may change back within one step.
        rates = jnp.max(jnp.abs(jax.vmap(scene.velocity_rates_of)(hub)), 1)
        explained = 2 * self.spacing * jnp.maximum(rates[1:], rates[:-1])
        explained = explained + _FLOOR * self.speed

        def longest(velocities: Array, signals: Array) -> Array:
            changes = jnp.max(jnp.abs(jnp.diff(velocities)), 0)
            sudden = jnp.any((changes > explained).reshape(64, 16), 1)
            return self.spacing * _longest_step(signals, sudden)

        found = velocities.T, signals
        if self.pauses.sided:
            # Changes at declared times, at which steps end, need no shorter steps.
            both = (jnp.stack([a, _between(self.pauses, self.spacing, a)]) for a in found)
            own, between = jax.vmap(longest)(*both)
            self.longest_step = jnp.where(own[:, :1] >= between[:, :1], own, between)
        else:
            self.longest_step = longest(*found)
        self.at_rest = jnp.maximum(_AT_REST * without_derivatives(moment), self.spacing)
        self.quick = _QUICK * without_derivatives(moment)
        self.velocities = scene.velocities_of(scene.hub(scene.after(jnp.zeros_like(times[0]))))

    @property
    def duration(self) -> Scalar:
        """The duration of the run, in s."""
        return SAMPLES * self.spacing

    def resting(self, scene: Scene, y: State, t: Any, end: Any) -> Array:
        """The end of a step from t and the state y, `end` or earlier, so that derivatives are
        accurate where nothing moves yet."""
        length, q, t, end = without_derivatives((scene.equations.length, y.q, t, end))
        still = jnp.max(jnp.abs(q)) <= _STILL * length
        return jnp.where(still, jnp.minimum(end, t + self.at_rest), end)

    def limit(self, t: Scalar, end: Scalar, adaptive: bool) -> Scalar:
        """The end of a step from t, `end` or earlier, so that no change of motion and loads is
        missed. `adaptive` controllers choose steps of any length."""
        cell = (t / (16 * self.spacing)).astype(int)
        within, cell_end, beyond = self.longest_step[cell]
        end = jnp.minimum(end, jnp.minimum(t + within, cell_end + beyond))
        if not self.pauses.first.size:
            return end
        stop = self.pauses.ahead(t)
        left, h = stop - t, end - t
        # Several equal steps lead up to a stop, in the place of long ones and a short remainder.
        parts = jnp.ceil(left / h - _LONGER)
        few = _LAST if adaptive else 2
        end = jnp.where(parts <= few, t + left / jnp.maximum(parts, 1.0), end)
        return jnp.where((parts <= 1) | (end >= self.pauses.early(stop)), stop, end)


def _between(pauses: Pauses, spacing: Scalar, signals: Float[Array, "c T"]) -> Float[Array, "c T"]:
    """Signals less the straight line between the first and the last sample between the same two
    declared times; zero at a declared time."""
    samples, near = np.arange(SAMPLES + 1), pauses.near + 1e-6 * spacing

    def passed(side: str, off: Scalar) -> Array:
        return jax.vmap(lambda t: place(pauses.first, t, side))(spacing * samples + off)

    which = passed("left", -near) + passed("right", near)
    first = jnp.searchsorted(which, which, side="left")
    last = jnp.searchsorted(which, which, side="right") - 1
    share = (samples - first) / jnp.maximum(last - first, 1)
    return jax.vmap(lambda s: s - (1 - share) * s[first] - share * s[last])(signals)


def _signals(hub: Hub, force: Any, span: Array | None) -> Float[Array, "c k"]:
    """The signals that forces depend on, each one number at every sample."""
    parts = [jax.vmap(lambda hub: hub.acceleration)(hub), hub.angular_velocity]
    # The load at the tip may be a `TipLoad`.
    parts += [hub.angular_velocity_rate, *jax.tree.leaves(force)]
    parts += [] if span is None else [span[:, row] for row in range(3)]
    return jnp.stack([_ASLANT @ part.T for part in parts])


def _longest_step(signals: Float[Array, "c T"], sudden: Bool[Array, " 64"]) -> Float[Array, "64 3"]:
    """The longest step in each cell of sixteen samples, the end of the cell, and how far a step may
    go beyond it, in samples.

    A cell is the whole run, an eighth of it, or an eighth of that, and a step within it a sixteenth
    of its length, the stride. It is divided where a signal rises and falls, or falls and rises,
    within one stride, by more than the second difference over strides is on average around it:
    error control might see nothing of that. What varies more slowly, or has a corner or a jump in
    it, is left to error control, since no step can fail to see it. Where the same happens within
    four samples, or the hub's velocity changes in a `sudden` way, steps are half a sample long.
    """
    floor = _FLOOR + 16 * float(jnp.finfo(signals.dtype).eps)
    either = jnp.concatenate([signals, -signals])

    def highest(values: Array, n: int, apart: int) -> Array:
        """The largest of each value and of n - 1 values after it, at distances `apart`."""
        return jax.lax.reduce_window(
            values, -jnp.inf, jax.lax.max, (1, n), (1, 1), "VALID", window_dilation=(1, apart)
        )

    def unseen(s: int, of_these: Float[Array, "C n"], bend: Float[Array, " k"]) -> Array:
        """Whether a change within parts of a stride s, with their middles there, rises and falls so
        that error control might not see it."""
        passed = of_these - highest(either, 2, s)
        passed = jax.lax.pad(passed, 0.0, [(0, 0, 0), (s // 2, s // 2 - 1, 0)])
        mean = jnp.pad(jnp.mean(bend.reshape(-1, s), 1)[1:-1], 2, mode="edge")
        around = (mean[:-2] + 2 * mean[1:-1] + mean[2:]) / 4
        # Without the barrier a GPU computes this again for every cell.
        passed = jax.lax.optimization_barrier(jnp.max(passed, 0))
        return jnp.max(passed.reshape(-1, s), 1) > _UNSEEN * around + floor

    strides = np.array([[1], [4], [8], [64]])
    place = np.arange(SAMPLES)
    before, after = place - strides, place + strides
    bends = signals[:, np.minimum(after, SAMPLES)] - 2 * signals[:, None, :-1]
    bends = jnp.max(jnp.abs(bends + signals[:, np.maximum(before, 0)]), 0)
    bends = jnp.where((before >= 0) & (after <= SAMPLES), bends, 0.0)
    within_four = highest(either, 5, 1)
    within_eight = highest(within_four, 2, 4)
    sudden |= jnp.any(unseen(4, within_four, bends[1]).reshape(64, 4), 1)
    divided = jnp.any(unseen(8, within_eight, bends[2]).reshape(8, 16), 1)
    divided |= jnp.any(sudden.reshape(8, 8), 1)
    all_divided = jnp.any(divided) | jnp.any(unseen(64, highest(within_eight, 8, 8), bends[3]))
    sharp = jnp.max(bends[0].reshape(64, 16), 1)
    of_eighths = jnp.max(bends.reshape(4, 8, 128), 2)
    sharper, sharpest = jnp.max(of_eighths[:3], 0), jnp.max(of_eighths)

    def chosen(a: Any, b: Any, c: Any) -> Array:
        return jnp.where(all_divided, jnp.where(divided[:, None], a, b), c).reshape(-1)

    def step(sharpest: Array, width: float) -> Array:
        return jnp.where(sharpest > floor, width / 16, width)

    start = np.arange(0.0, SAMPLES, 16).reshape(8, 8)
    small = jnp.where(sudden, 0.5, step(sharp, 16.0)).reshape(8, 8)
    steps = chosen(small, step(sharper, 128.0)[:, None], step(sharpest, 1024.0))
    ends = chosen(start + 16, start[:, :1] + 128, SAMPLES)
    beyond = jnp.concatenate([steps, jnp.zeros_like(steps[:1])])[(ends / 16).astype(int)]
    return jnp.stack([steps, ends, beyond], 1)
