"""Cubic splines through points, as matrices, since they are linear in the values at these."""

import numpy as np
from jaxtyping import Float


def spline_rows(
    knots: Float[np.ndarray, " k"], places: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """Matrices from k values at increasing knots to the values, and to the slopes, at m places of
    the cubic spline through them. Its third derivative does not jump at the second knot and at the
    one before the last ("not a knot"). Two knots give a line, three a parabola."""
    count, gaps = len(knots), np.diff(knots)
    left = np.clip(np.searchsorted(knots, places, side="right") - 1, 0, count - 2)
    gap = gaps[left]
    t = ((places - knots[left]) / gap)[:, None]
    unit, slopes = np.eye(count), _slopes(knots)
    first, last = unit[left], unit[left + 1]
    start, end = (gap[:, None] * slopes[i] for i in (left, left + 1))
    rise = last - first
    # Hermite's cubic: first + t start + t^2 bend + t^3 twist.
    bend, twist = 3 * rise - 2 * start - end, start + end - 2 * rise
    value = first + t * (start + t * (bend + t * twist))
    return value, (start + t * (2 * bend + 3 * t * twist)) / gap[:, None]


def _slopes(knots: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k k"]:
    """The matrix from values at the knots to slopes of the spline there."""
    count, h = len(knots), np.diff(knots)
    rises = np.diff(np.eye(count), axis=0) / h[:, None]
    if count == 2:
        return np.concatenate([rises, rises])
    if count == 3:
        bend = (rises[1] - rises[0]) / (h[0] + h[1])
        return np.stack([rises[0] - h[0] * bend, rises[0] + h[0] * bend, rises[1] + h[1] * bend])
    system, right = np.zeros((count, count)), np.zeros((count, count))
    for i in range(1, count - 1):
        system[i, i - 1 : i + 2] = h[i], 2 * (h[i - 1] + h[i]), h[i - 1]
        right[i] = 3 * (h[i] * rises[i - 1] + h[i - 1] * rises[i])
    for row, one, two, near in ((0, h[0], h[1], (0, 1)), (-1, h[-1], h[-2], (-1, -2))):
        total = one + two
        system[row, [row, near[1]]] = two, total
        right[row] = ((one + 2 * total) * two * rises[near[0]] + one**2 * rises[near[1]]) / total
    return np.linalg.solve(system, right)
