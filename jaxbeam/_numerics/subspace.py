"""What a few combinations of many columns keep of them, one case at a time."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._programs.batches import one_by_one


@one_by_one
def principal(a: Float[Array, "m n"], start: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Combinations of the columns of a tall matrix, orthonormal, that have most of it: one step of
    subspace iteration from combinations that have nearly that, a third of what singular vectors
    take. Of a matrix without derivatives: those of vectors of values that are alike do not exist.
    """
    rows, _ = jnp.linalg.qr(a.T @ jnp.linalg.qr(a @ start)[0])
    r = jnp.linalg.qr(a @ rows, mode="r")
    # Nothing but rounding is left of a direction that does nothing: it stays as small as that.
    own = jnp.diag(r)
    least = jnp.finfo(r.dtype).eps * jnp.max(jnp.abs(own))
    r = r + jnp.diag(jnp.where(jnp.abs(own) < least, least - own, 0.0))
    return jax.lax.linalg.triangular_solve(r, rows)
