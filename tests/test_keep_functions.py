"""Which function of a user it is: the same in another process, and another after any change."""

import functools
import importlib.util
import itertools
import json
import math
import random

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._programs.functions import identity
from jaxbeam._programs.structure import NotKept

SOURCE = """
import math
import os
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import jaxbeam as jb

SCALE = 3.0
ROWS = jnp.arange(3.0)
BEAM = jb.Beam.from_slenderness(70.0)


def helper(x):
    return SCALE * x + math.pi


@jax.jit
def inner(x):
    return helper(x) ** 2


@jax.custom_jvp
def ruled(x):
    return 2 * x


@ruled.defjvp
def _rule(primals, tangents):
    return ruled(*primals), 2 * tangents[0]


def made(factor):
    return lambda x: factor * x


scaled = made(5.0)


def f(x, power=2):
    def local(y):
        return helper(y) ** power

    return local(x) + inner(x) + ruled(x) + scaled(x) + ROWS.sum() + len([1]) + BEAM.length
"""
names = itertools.count()


def module(source, tmp_path):
    """A user's module with this text."""
    path = tmp_path / f"users_{next(names)}.py"
    path.write_text(source)
    spec = importlib.util.spec_from_file_location("users", path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def text(function):
    return json.dumps(identity(function))


@pytest.mark.parametrize(
    "made",
    [
        lambda f: f, jax.grad, jax.value_and_grad, jax.jacfwd, jax.jacrev, jax.hessian, jax.vmap,
        jax.jit, jax.checkpoint, eqx.filter_grad, lambda f: functools.partial(f, power=3),
        lambda f: jax.jit(jax.vmap(jax.grad(f), in_axes=(0,))),
    ],
)  # fmt: skip
def test_the_same_text_is_the_same_function(made, tmp_path):
    """Wherever it stands, and however often it was called."""
    one = module(SOURCE, tmp_path)
    other = module("# moved\n\n" + SOURCE, tmp_path)
    said = text(made(one.f))
    assert said == text(made(other.f))
    for _ in range(30):
        one.f(1.0)
    assert said == text(made(one.f))


CHANGES = {
    "a number of the module": ("SCALE = 3.0", "SCALE = 3.5"),
    "its type": ("SCALE = 3.0", "SCALE = 3"),
    "an array": ("arange(3.0)", "arange(1.0, 4.0)"),
    "a type of an array": ("arange(3.0)", "arange(3)"),
    "a beam": ("slenderness(70.0)", "slenderness(71.0)"),
    "a helper": ("SCALE * x + math.pi", "SCALE * x - math.pi"),
    "a constant of a helper": ("+ math.pi", "+ math.e"),
    "a jitted function": ("helper(x) ** 2", "helper(x) ** 4"),
    "a rule": ("2 * tangents[0]", "3 * tangents[0]"),
    "a ruled function": ("    return 2 * x", "    return 4 * x"),
    "a closure": ("made(5.0)", "made(6.0)"),
    "what makes it": ("factor * x", "factor + x"),
    "a default": ("power=2", "power=3"),
    "a local function": ("helper(y) ** power", "helper(y) * power"),
    "itself": ("local(x) + inner(x)", "local(x) - inner(x)"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_any_change_is_another_function(change, tmp_path):
    before, after = CHANGES[change]
    assert SOURCE.count(before) == 1
    one, other = module(SOURCE, tmp_path), module(SOURCE.replace(before, after), tmp_path)
    for made in (lambda f: f, jax.grad, jax.jit):
        assert text(made(one.f)) != text(made(other.f))


class Own:
    x = 1.0


OWN, DRAWN = Own(), random.random


def changes():
    global OWN
    OWN = Own()


def imports(x):
    import os

    return x * len(os.environ)


def _no(x):
    return x


_no.factor = 2.0


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (lambda x: OWN.x * x, "an object of the class Own"),
        (lambda x: Own().x * x, "the class Own"),
        (lambda x: x * DRAWN(), "random, which may read"),
        (lambda x: random.gauss() * x, "random, which may read"),
        (lambda x: x * len(open("numbers").read()), "the name open"),  # noqa: SIM115
        (lambda x: x * eval("2"), "the name eval"),
        (lambda x: x * np.load("numbers"), "load, which may read"),
        (lambda x: x * np.random.default_rng().normal(), "random, which may read"),
        (lambda x: x * jb.blades.read_blade("b").length, "read_blade, which may read"),
        (lambda x: x * nowhere, "the name nowhere"),  # noqa: F821
        (lambda x: x * pytest.__version__, "the module pytest"),
        (changes, "OWN, which it changes"),
        (imports, "the module os"),
        (_no, "attributes of the function _no"),
        (functools.partial(_no, Own()), "class Own|attributes"),
        (Own().__init__, "class"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_from_others(function, why):
    with pytest.raises(NotKept, match=why):
        identity(function)


def test_what_refers_to_itself():
    def countdown(n):
        return countdown(n - 1) if n else math.pi

    assert text(countdown) == text(countdown)


def test_kept_is_jit():
    """Numbers of Python are its arguments; results are arrays."""
    traced = []

    @jb.programs.kept
    def f(x, *, other):
        """What it is."""
        traced.append(x)
        return {"sum": x + other["a"], "three": 3, "none": None}

    for x in (1.0, 2.0):
        found = f(x, other={"a": np.float64(2.0)})
        assert found["none"] is None
        assert float(found["sum"]) == x + 2
        assert isinstance(found["three"], jax.Array)
    assert len(traced) == 1
    assert f.__doc__ == "What it is."
    assert float(jax.grad(lambda x: f(x, other={"a": 2.0})["sum"])(1.0)) == 1.0
    assert jax.vmap(lambda x: f(x, other={"a": x})["sum"])(jnp.arange(3.0)).shape == (3,)
    with pytest.raises(TypeError, match="function must be a function, got int"):
        jb.programs.kept(3)
