"""The modes that a caller asks for, by number or by labels."""

import operator
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_model
from jaxbeam._rotor.directions import Direction, Label

_ModeCounts = tuple[int, int, int, int]
_FEW = 3  # counts of modes of a direction are rounded up to a multiple of this: fewer programs


class Wanted(eqx.Module):
    """A request for the lowest `count` modes, or for those of `count` labels.

    Directions and numbers of labels are arrays, so that other labels need no new program, unless
    their counts by direction exceed `most`, which is static.
    """

    count: int = eqx.field(static=True)
    most: _ModeCounts = eqx.field(static=True)  # modes of each `Direction` at most
    named: tuple[Int[Array, " k"], Int[Array, " k"]] | None  # directions and numbers; None: lowest


def lowest(model: AbstractModel, count: int) -> Wanted:
    """The request for the lowest modes of all directions; growing ones come first."""
    # Axial frequencies grow with the number of the mode, those of bending with its square: few of
    # the lowest are axial.
    return Wanted(count, _at_most(model, (min(count, _FEW), count, count, count)), None)


def lowest_in_plane(model: AbstractModel, count: int) -> Wanted:
    """The request for the lowest modes of in-plane bending and axial motion."""
    return Wanted(count, _at_most(model, (min(count, _FEW), count, 0, 0)), None)


def _at_most(model: AbstractModel, counts: _ModeCounts) -> _ModeCounts:
    """The counts of modes of each direction, limited to what the model has."""
    available = [model.directions.count(direction) for direction in Direction]
    axial, in_plane, flap, torsion = (min(*both) for both in zip(counts, available, strict=True))
    return axial, in_plane, flap, torsion


def _of_labels(model: AbstractModel, labels: Sequence[Label]) -> Wanted:
    named = np.array([(int(direction), number) for direction, number in labels])
    # In-plane and axial modes are coupled, and each gets its label by comparison with both kinds.
    always = Direction.IN_PLANE, Direction.AXIAL
    axial, in_plane, flap, torsion = (
        -(-max([direction in always, *(k for f, k in labels if f == direction)]) // _FEW) * _FEW
        for direction in Direction
    )
    most = _at_most(model, (axial, in_plane, flap, torsion))
    return Wanted(len(labels), most, (jnp.asarray(named[:, 0]), jnp.asarray(named[:, 1])))


def choose(model: AbstractModel, which: int | Sequence[Label] | None) -> Wanted:
    """The modes that `which` asks for, checked against what the model has."""
    total = len(checked_model(model).directions)
    if which is None:
        return lowest(model, min(6, total))
    if isinstance(which, Label):
        which = (which,)
    if not isinstance(which, Sequence):
        if isinstance(which, bool) or np.shape(which) or not hasattr(which, "__index__"):
            raise TypeError(f"which must be an int or labels, got {which!r}")
        try:
            count = operator.index(which)
        except TypeError:  # raised for an array of floats
            raise TypeError(f"which must be an int or labels, got {which!r}") from None
        if not 1 <= count <= total:
            raise ValueError(f"which must be between 1 and {total} for this model, got {count}")
        return lowest(model, count)
    if not which:
        raise ValueError("which must name at least one mode")
    for label in which:
        if not isinstance(label, Label) or not isinstance(label.direction, Direction):
            raise TypeError(f"which: not a Label: {label!r}; make them with jaxbeam.labels")
        if isinstance(label.number, bool) or not isinstance(label.number, int):
            raise TypeError(f"which: the number of a Label must be an int, got {label.number!r}")
        available = model.directions.count(label.direction)
        if not 1 <= label.number <= available:
            raise ValueError(
                f"which: this model has {available} modes of {label.direction.title}, "
                f"so there is no {label}"
            )
    return _of_labels(model, which)
