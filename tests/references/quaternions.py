"""Rotations as quaternions q = (w, x, y, z), the components along the first axis."""

import numpy as np


def rotation(q: np.ndarray) -> np.ndarray:
    """The rotation matrices (3, 3, k) of unit quaternions (4, k): columns are the turned axes.

    Without complex conjugation, so that complex steps pass through.
    """
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def times_vector(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The products of quaternions q (4, ...) and (0, v) for vectors v (3, ...)."""
    w, u = q[:1], q[1:]
    return np.concatenate([-np.sum(u * v, 0)[None], w * v + np.cross(u, v, axis=0)])
