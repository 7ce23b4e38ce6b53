"""Numbers that something is made of, with what they may be."""

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

FULL_TURN = 2 * np.pi * (1 + 1e-6)  # in rad, also where it was rounded to a shorter float


def parameter(status: Status, *, zero: bool | None = False, most: float | None = None) -> Any:
    """A field of a scalar that is positive, or `zero`; with None it may have any sign, and be no
    more than `most` either way. `status` is the code where that is broken."""
    return eqx.field(metadata={"status": status, "zero": zero, "most": most})


def whole(status: Status, valid: Callable[[Any], Any]) -> Any:
    """Field of an array of which a function says, as a whole, whether it is in range."""
    return eqx.field(metadata={"status": status, "valid": valid})


def along_span(status: Status) -> Any:
    """Field of a positive property, a scalar or one that varies along the span."""
    return eqx.field(metadata={"status": status, "zero": False, "varies": True})


def optional(
    status: Status, *, zero: bool | None = False, varies: bool = False, of_torsion: bool = False
) -> Any:
    """Field of a number that need not be there: without it the program has nothing of the kind.

    With `zero=None` it may have any sign. At what is `of_torsion` models without torsion do not
    look.
    """
    return _optional(status=status, zero=zero, varies=varies, of_torsion=of_torsion)


def angle(status: Status, most: float, *, varies: bool = False) -> Any:
    """Field of an angle in rad that need not be there, of no more than that either way: larger
    ones are most often degrees."""
    return _optional(status=status, zero=None, varies=varies, most=most)


def part() -> Any:
    """Field of parameters that are always there."""
    return eqx.field()


def _optional(**rule: Any) -> Any:
    return eqx.field(default=None, metadata={**rule, "optional": True})


class Parameters(eqx.Module):
    """Numbers with rules, each at its field, checked when built from numbers that are known.

    A further one is a field with its rule and an argument of `__init__` of the same name.
    """

    def _take(self, given: Mapping[str, Any]) -> None:
        """Set each field from the argument of its name; those with a rule as scalars, or as
        properties along the span."""
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
                with jax.ensure_compile_time_eval():  # under `jit` it would be traced
                    fine = bool(rule["valid"](value))
                if not fine:
                    raise ValueError(rule["status"].message)
            else:
                check(rule["status"], value, rule["zero"], rule.get("most"))

    def status(self, angular_speed: Scalar) -> Code:
        """`Status` of the parameters: the first that is out of range. Works under `jit`, `vmap`."""
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
        """Name and rule of each field that need not be there and is; names within a part begin with
        its own."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.default is None and value is not None:
                yield field.name, field.metadata
            if isinstance(value, Parameters):
                yield from ((f"{field.name}.{name}", rule) for name, rule in value._given())

    @property
    def given(self) -> frozenset[str]:
        """Names of all that is there and need not be."""
        return frozenset(name for name, _ in self._given())

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features that a model has to know, beyond what is always there."""
        return tuple(name for name, rule in self._given() if not rule.get("of_torsion"))

    @property
    def is_plain(self) -> bool:
        """Whether there are no features: of a rotor, whether its beam is uniform and clamped to the
        hub, with no more than a point at its tip."""
        return not self.features

    def checked(self) -> Self:
        """A rebuilt copy, so that what comes from `eqx.tree_at` or `vmap` meets the checks as
        well."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        parts = Parameters | AbstractSpanwise
        return type(self)(
            **{n: v.checked() if isinstance(v, parts) else v for n, v in values.items()}
        )
