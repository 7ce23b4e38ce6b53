"""Which modes are asked for."""

import operator
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxbeam._models.base import AbstractModel, checked_model
from jaxbeam._models.families import Family, Label

_Counts = tuple[int, int, int, int]
_FEW = 3  # labels up to here share a program, as do those up to twice as many


class Wanted(eqx.Module):
    """The lowest `count` modes, or as many of these families and numbers.

    Families and numbers are arrays, so that asking for other labels does not compile anew; how many
    of each family may be among them is not.
    """

    count: int = eqx.field(static=True)
    most: _Counts = eqx.field(static=True)  # of each `Family`
    named: tuple[Int[Array, " k"], Int[Array, " k"]] | None


def lowest(model: AbstractModel, count: int) -> Wanted:
    """The lowest modes; growing ones come first."""
    # Axial frequencies grow with the number, those of bending with its square.
    return Wanted(count, _at_most(model, (min(count, _FEW), count, count, count)), None)


def lowest_in_plane(model: AbstractModel, count: int) -> Wanted:
    """Those of bending in the plane of rotation and of axial motion."""
    return Wanted(count, _at_most(model, (min(count, _FEW), count, 0, 0)), None)


def _at_most(model: AbstractModel, counts: _Counts) -> _Counts:
    """As many of each family as there are, at most."""
    here = [model.families.count(family) for family in Family]
    axial, in_plane, flap, torsion = (min(*both) for both in zip(counts, here, strict=True))
    return axial, in_plane, flap, torsion


def _of_labels(model: AbstractModel, labels: Sequence[Label]) -> Wanted:
    named = np.array([(int(family), order) for family, order in labels])
    # What is in the plane is told apart by both families there.
    always = Family.IN_PLANE, Family.AXIAL
    axial, in_plane, flap, torsion = (
        -(-max([family in always, *(k for f, k in labels if f == family)]) // _FEW) * _FEW
        for family in Family
    )
    most = _at_most(model, (axial, in_plane, flap, torsion))
    return Wanted(len(labels), most, (jnp.asarray(named[:, 0]), jnp.asarray(named[:, 1])))


def choose(model: AbstractModel, which: int | Sequence[Label] | None) -> Wanted:
    """`which` of `modes`, checked against what the model has."""
    total = len(checked_model(model).families)
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
        if not isinstance(label, Label) or not isinstance(label.family, Family):
            raise TypeError(f"which: not a Label: {label!r}; make them with jaxbeam.labels")
        if isinstance(label.order, bool) or not isinstance(label.order, int):
            raise TypeError(f"which: the order of a Label must be an int, got {label.order!r}")
        available = model.families.count(label.family)
        if not 1 <= label.order <= available:
            raise ValueError(
                f"which: this model has {available} modes of {label.family.title}, "
                f"so there is no {label}"
            )
    return _of_labels(model, which)
