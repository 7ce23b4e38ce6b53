"""Checks of the model, rotor and speed that public functions are given."""

from typing import Any

import numpy as np

from jaxbeam._checks import kind_of
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._types import Scalar, is_concrete


def checked_model(model: Any) -> AbstractModel:
    """The argument, if it is a model; raises `TypeError` otherwise."""
    if not isinstance(model, AbstractModel):
        raise TypeError(f"model must be a model, such as jaxbeam.Hybrid(), got {kind_of(model)}")
    return model


def checked_case(
    model: Any, rotor: Any, angular_speed: Any = 0.0
) -> tuple[AbstractModel[Any], Any, Scalar]:
    """A model as it suits a rotor at an angular speed, the rotor that it takes, and the speed, all
    checked. Public functions begin with that."""
    return checked_model(model).with_case(rotor, angular_speed)


def fastest(speeds: Any) -> Any:
    """The largest magnitude of several speeds that are concrete and finite; zero for others."""
    values = np.asarray(speeds, float) if is_concrete(speeds) else np.zeros(0)
    return np.max(np.abs(values[np.isfinite(values)]), initial=0.0)
