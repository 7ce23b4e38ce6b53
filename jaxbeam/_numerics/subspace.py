"""Subspaces of the columns of a matrix, one case at a time."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._programs.batches import one_by_one


@one_by_one
def principal(a: Float[Array, "m n"], start: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """The k combinations c of columns of a tall matrix for which a c is orthonormal and spans most
    of its column space, by one step of subspace iteration from combinations `start` that span
    nearly that: a third of the time of singular vectors. Without derivatives, since singular
    vectors of equal values have none.
    """
    rows, _ = jnp.linalg.qr(a.T @ jnp.linalg.qr(a @ start)[0])
    r = jnp.linalg.qr(a @ rows, mode="r")
    # Directions in which a is zero have only rounding on the diagonal of r: at least eps of the
    # largest entry takes its place, so that they are not scaled up to length one.
    diagonal = jnp.diag(r)
    least = jnp.finfo(r.dtype).eps * jnp.max(jnp.abs(diagonal))
    r = r + jnp.diag(jnp.where(jnp.abs(diagonal) < least, least - diagonal, 0.0))
    return jax.lax.linalg.triangular_solve(r, rows)
