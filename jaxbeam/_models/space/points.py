"""Points of the axis of an element in space: curvatures before the turn, and their derivatives.

With p = r', q = L r'', t = p / |p| = (x, y, z) and u = (y, z) / (1 + x), the frame to which the
least rotation brings the axes is t, n_i = e_i - u_i (t + e_1), and

    k_2 = n_2.q / |p|,   k_3 = n_3.q / |p|,   k_1 = u_3 k_2 - u_2 k_3

are the formulae of `_models/space/energies.py`. A change of p is |p| (eps t + phi_2 n_2 +
phi_3 n_3), one of q is |p| (theta_1 t + theta_2 n_2 + theta_3 n_3). As u are the coordinates of t
in a projection that keeps angles, they change by c phi, c = 1 / (1 + x), and the frame turns about
t by omega = u_3 phi_2 - u_2 phi_3. So with e = t.q / |p|

    dk_2 = theta_2 - eps k_2 - e phi_2 + omega k_3,
    dk_3 = theta_3 - eps k_3 - e phi_3 - omega k_2,

and all derivatives are polynomials in these numbers.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import append_axes, compute_once, sum_of_products
from jaxbeam._types import Number


class Points(NamedTuple):
    """Points with vectors p and q, (*g) of them, axes of lanes included. The order of derivatives
    is that of both vectors, or of (eps, phi_2, phi_3) and (theta_1, theta_2, theta_3)."""

    rows: Float[Array, "3 3 *g"]  # t, n_2 and n_3 over |p|
    u2: Number
    u3: Number
    c: Number
    seen: Float[Array, "3 *g"]  # e, k_2, k_3

    @classmethod
    def of(cls, p: Float[Array, "3 *g"], q: Float[Array, "3 *g"]) -> "Points":
        size = jnp.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        over, share, unit = 1 / size, 1 / (size + p[0]), np.eye(3)
        t, u2, u3 = p * over[None], p[1] * share, p[2] * share
        lean = t + append_axes(unit[0], p.ndim - 1)
        across = [append_axes(unit[i], p.ndim - 1) - u[None] * lean for i, u in ((1, u2), (2, u3))]
        rows = jnp.stack([t * over[None], *(n * over[None] for n in across)])
        rows, u2, u3, c = compute_once((rows, u2, u3, size * share))
        return cls(
            rows, u2, u3, c, compute_once(sum_of_products(rows, q[None], 1, max(q.ndim - 1, 1)))
        )

    @property
    def rise(self) -> Number:
        """The curvature component k_1 at the points."""
        return self.u3 * self.seen[1] - self.u2 * self.seen[2]

    def forces(self, moments: Float[Array, "3 *#g"]) -> tuple[Number, ...]:
        """The forces of moments of k_1, k_2 and k_3 on changes of p and q."""
        m1, m2, m3 = moments
        (e, k2, k3), u2, u3 = self.seen, self.u2, self.u3
        a, b = m2 + m1 * u3, m3 - m1 * u2
        bend, twist = a * k3 - b * k2, m1 * self.c
        by_phi = u3 * bend - a * e - twist * k3, twist * k2 - u2 * bend - b * e
        return -a * k2 - b * k3, *by_phi, jnp.zeros_like(a), a, b

    def second(self, moments: Float[Array, "3 *g"]) -> Float[Array, "2 3 3 *g"]:
        """The change of the force of moments on p with p and with q, if the moments stay as they
        are."""
        m1, m2, m3 = moments
        (e, k2, k3), u2, u3 = self.seen, self.u2, self.u3
        a, b, twist = compute_once((m2 + m1 * u3, m3 - m1 * u2, m1 * self.c))
        k1, along = compute_once((self.rise, u2 * k2 + u3 * k3))
        first = 2 * (a * (e - k3 * u3) + (b * u3) * k2 + twist * k3)
        second = 2 * (a * u2 * k3 + b * (e - k2 * u2) - twist * k2)
        both = a * (k3 * (u3 * u3 - u2 * u2 - 1) / 2 - e * u3 + k2 * u2 * u3)
        both = both + b * (k2 * (u2 * u2 - u3 * u3 - 1) / 2 - e * u2 + k3 * u2 * u3)
        twice = (
            b * (2 * e * u3 - k3 - u3 * along) - a * (2 * k2 + u3 * k1) + twist * k1,
            a * (2 * e * u2 - k2 - u2 * along) - b * (2 * k3 - u2 * k1) + twist * k1,
        )
        own = [2 * (a * k2 + b * k3), first, second, first, twice[0], both, second, both, twice[1]]
        mixed = [0 * a, -a, -b, -a, -b * u3, a * u3 - twist, -b, b * u2 + twist, -a * u2]
        found = compute_once(jnp.stack([*own, *mixed]).reshape(2, 3, 3, *a.shape))
        found = compute_once(
            sum_of_products(self.rows[None, :, :, None], found[:, :, None], 1, a.ndim)
        )
        return sum_of_products(self.rows[None, None], found[:, :, :, None], 2, a.ndim)
