"""Where elements of a rod end."""

import functools
import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._rotor.beam_sections import sections_of
from jaxbeam._types import is_concrete

_SOFTER = 300.0  # than another section in one element, of compliances


def breaks_of(beam: Any) -> tuple[float, ...]:
    """Places at which elements of a beam end: its breaks, and masses at points."""
    points = () if beam.point_masses is None else beam.point_masses.places
    return tuple(sorted({*sections_of(beam).breaks, *points}))


def soft_breaks(beam: Any) -> tuple[float, ...] | None:
    """Places between which no section is softer than another by more than `_SOFTER` in stretch,
    torsion or bending: one polynomial of the forces cannot follow more. None where numbers are
    traced."""
    if beam.is_uniform:
        return ()
    if not all(map(is_concrete, jax.tree.leaves(beam))):
        return None
    leaves, structure = jax.tree.flatten(beam)
    return _soft_breaks(structure, tuple(_Same(np.asarray(leaf)) for leaf in leaves))


class _Same:
    """Numbers that compare equal if their bytes are."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers
        self._key = numbers.tobytes(), numbers.shape, numbers.dtype

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self._key == other._key


@functools.lru_cache(maxsize=64)
def _soft_breaks(structure: Any, leaves: tuple[_Same, ...]) -> tuple[float, ...]:
    with jax.ensure_compile_time_eval():
        arrays = [jnp.asarray(leaf.numbers) for leaf in leaves]
        sections = sections_of(jax.tree.unflatten(structure, arrays))
        pieces = itertools.pairwise(sections.edges)
        places = np.concatenate([np.linspace(start, end, 9)[:-1] for start, end in pieces])
        stiffness = np.asarray(sections.stiffness_at(places))
    compliance = np.linalg.inv(stiffness)  # by JAX it would be traced in a batch
    soft = np.log(np.diagonal(compliance, axis1=1, axis2=2)[:, [0, 3, 4, 5]])
    out, least, most = [], soft[0], soft[0]
    for before, here in zip(places, soft[1:], strict=False):
        least, most = np.minimum(least, here), np.maximum(most, here)
        if np.max(most - least) > np.log(_SOFTER):
            out.append(float(before))
            least = most = here
    return tuple(out)


def element_edges(breaks: tuple[float, ...], elements: int) -> tuple[float, ...]:
    """Ends of elements, about so many, of nearly one length, one at least between two breaks."""
    ends = [0.0, *breaks, 1.0]
    out = [0.0]
    for start, end in itertools.pairwise(ends):
        parts = max(round((end - start) * elements), 1)
        out += np.linspace(start, end, parts + 1)[1:].tolist()
    return tuple(out)
