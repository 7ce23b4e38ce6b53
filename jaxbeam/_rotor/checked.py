"""Checks of the rotor that a public function is given."""

import warnings
from typing import Any

import jax

from jaxbeam._checks import check_kind
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.spring_rotor import SpringRotor


def checked_rotor(kind: type[Rotor] | type[SpringRotor], rotor: Any) -> Any:
    """The rotor, checked for structure and, where numbers are concrete, for range.

    All public functions that take a rotor call this; it warns where 64-bit floats are off.
    """
    if not jax.config.read("jax_enable_x64"):
        warnings.warn(
            "jax runs in 32-bit floats: results will carry about three digits. Call "
            "jax.config.update('jax_enable_x64', True) before anything else.",
            stacklevel=4,
        )
    check_kind("rotor", rotor, kind)
    return rotor.checked()
