"""Which modes are asked for."""

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
_FEW = 3  # labels up to here share a program, as do those up to twice as many


class Wanted(eqx.Module):
    """The lowest `count` modes, or as many of these directions and numbers.

    Directions and numbers are arrays, so that asking for other labels does not compile anew; how
    many of each direction may be among them is not.
    """

    count: int = eqx.field(static=True)
    most: _ModeCounts = eqx.field(static=True)  # of each `Direction`
    named: tuple[Int[Array, " k"], Int[Array, " k"]] | None


def lowest(model: AbstractModel, count: int) -> Wanted:
    """The wish for the lowest modes; growing ones come first."""
    # Axial frequencies grow with the number, those of bending with its square.
    return Wanted(count, _at_most(model, (min(count, _FEW), count, count, count)), None)


def lowest_in_plane(model: AbstractModel, count: int) -> Wanted:
    """The wish for the lowest modes of bending in the plane of rotation and of axial motion."""
    return Wanted(count, _at_most(model, (min(count, _FEW), count, 0, 0)), None)


def _at_most(model: AbstractModel, counts: _ModeCounts) -> _ModeCounts:
    """The counts of modes of each direction, of which there are no more than the model has."""
    here = [model.directions.count(direction) for direction in Direction]
    axial, in_plane, flap, torsion = (min(*both) for both in zip(counts, here, strict=True))
    return axial, in_plane, flap, torsion


def _of_labels(model: AbstractModel, labels: Sequence[Label]) -> Wanted:
    named = np.array([(int(direction), number) for direction, number in labels])
    # What is in the plane is told apart by both directions there.
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
        except TypeError:  # of an array of floats
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
