"""What loops ask of a batch: whether something holds in any of its lanes."""

from typing import Any

import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

# Whether something holds in any lane of a batch. A loop that asks this goes on for all lanes alike,
# and what is written into its buffers is not copied for the sake of lanes that are done.
anywhere = Primitive("anywhere")
anywhere.def_impl(lambda x: x)
anywhere.def_abstract_eval(lambda x: x)
mlir.register_lowering(anywhere, lambda _, x: [x])


def _anywhere_in_batch(given: Any, _: Any) -> Any:
    return anywhere.bind(jnp.any(given[0], 0)), None


batching.primitive_batchers[anywhere] = _anywhere_in_batch
