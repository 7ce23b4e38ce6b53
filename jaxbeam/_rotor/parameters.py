"""Parameters of beams, rotors and so on, with rules of the range that each must be in."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._checks import is_valid
from jaxbeam._rotor.spanwise import AbstractSpanwise, check, samples, taken
from jaxbeam._status import Status
from jaxbeam._types import Code, Scalar, is_concrete

FULL_TURN = 2 * np.pi * (1 + 1e-6)  # rad, with room for rounding to 32 bits


def parameter(status: Status, *, zero: bool | None = False, most: float | None = None) -> Any:
    """A field of a scalar that must be positive, or with `zero` not negative; with `zero=None` it
    may have any sign, and at most the magnitude `most`. `status` is the code where it is not."""
    return eqx.field(metadata={"status": status, "zero": zero, "most": most})


def whole(status: Status, valid: Callable[[Any], Any]) -> Any:
    """A field of an array for which a function `valid` says whether it is allowed."""
    return eqx.field(metadata={"status": status, "valid": valid})


def along_span(status: Status) -> Any:
    """A field of a positive property: a scalar, or one that varies along the span."""
    return eqx.field(metadata={"status": status, "zero": False, "varies": True})


def optional(
    status: Status, *, zero: bool | None = False, varies: bool = False, of_torsion: bool = False
) -> Any:
    """A field of a number that may be None: then programs contain nothing of the kind.

    With `zero=None` it may have any sign. With `of_torsion` models without torsion ignore it.
    """
    return _optional(status=status, zero=zero, varies=varies, of_torsion=of_torsion)


def angle(status: Status, most: float, *, varies: bool = False) -> Any:
    """A field of an angle in rad, or None, of magnitude `most` at most: larger numbers are likely
    to be degrees."""
    return _optional(status=status, zero=None, varies=varies, most=most)


def required() -> Any:
    """A field of other `Parameters` that is never None."""
    return eqx.field()


def _optional(**rule: Any) -> Any:
    return eqx.field(default=None, metadata={**rule, "optional": True})


class Parameters(eqx.Module):
    """Numbers with a rule at the field of each, checked when an object is made of concrete ones.

    To add a number, add a field with a rule and an argument of `__init__` of the same name.
    """

    def _take(self, given: Mapping[str, Any]) -> None:
        """Set each field from the argument of its name, converted to a scalar or a property along
        the span if it has a rule."""
        for field in dataclasses.fields(self):
            value, rule = given[field.name], field.metadata
            if rule and not (value is None and "optional" in rule):
                value = taken(field.name, value, rule.get("varies", False))
            setattr(self, field.name, value)

    def __check_init__(self) -> None:
        for field in dataclasses.fields(self):
            value, rule = getattr(self, field.name), field.metadata
            if "status" not in rule or value is None or not is_concrete(value):
                continue
            if "valid" in rule:
                with jax.ensure_compile_time_eval():  # a number, also within a traced function
                    fine = bool(rule["valid"](value))
                if not fine:
                    raise ValueError(rule["status"].message)
            else:
                check(rule["status"], value, rule["zero"], rule.get("most"))

    def status(self, angular_speed: Scalar) -> Code:
        """`Status` of the first parameter that is out of range; works under `jit` and `vmap`."""
        code = jnp.where(jnp.isfinite(angular_speed), Status.OK, Status.INVALID_ANGULAR_SPEED)
        for value, rule in reversed([*self._rules()]):
            if "valid" in rule:
                fine = rule["valid"](value)
            else:
                fine = is_valid(samples(value), rule["zero"], rule.get("most"))
            code = jnp.where(jnp.all(fine) if fine.ndim else fine, code, rule["status"])
        return code

    def _rules(self) -> Iterator[tuple[Any, Mapping[str, Any]]]:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Parameters):
                yield from value._rules()
            elif value is not None and "status" in field.metadata:
                yield value, field.metadata

    def _given(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Name and rule of each field that may be None and is not. Fields of parameters within
        these are named after both, as `tip_body.flap_inertia`."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.default is None and value is not None:
                yield field.name, field.metadata
            if isinstance(value, Parameters):
                yield from ((f"{field.name}.{name}", rule) for name, rule in value._given())

    @property
    def given(self) -> frozenset[str]:
        """Names of all fields that may be None and are not."""
        return frozenset(name for name, _ in self._given())

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that a model has to know: fields that may be None and are not."""
        return tuple(name for name, rule in self._given() if not rule.get("of_torsion"))

    @property
    def is_plain(self) -> bool:
        """Whether there are no features: of a rotor, whether its beam is uniform and clamped to the
        hub, with no more than a point at its tip."""
        return not self.features

    def checked(self) -> Self:
        """A copy made by the constructor, so that numbers set by `eqx.tree_at` or `vmap` are
        checked."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        parts = Parameters | AbstractSpanwise
        return type(self)(
            **{n: v.checked() if isinstance(v, parts) else v for n, v in values.items()}
        )
