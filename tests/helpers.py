"""Tools shared by the tests."""

import dataclasses
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

import jaxbeam as jb
from jaxbeam._rotor.ends import PointMass
from tests.beams import AS_BUILT
from tests.compilation import xla_flags


def rules(kind: type) -> dict[str, Mapping[str, Any]]:
    """Rules of the parameters that any such part of a rotor has itself, by name."""
    fields = dataclasses.fields(kind)
    own = {field.name: field.metadata for field in fields if field.metadata}
    return {name: rule for name, rule in own.items() if "optional" not in rule}


OF_ROTOR = rules(jb.Rotor) | {"tip_mass": rules(PointMass)["mass"]}
BEAM, SPRINGS = tuple(rules(jb.Beam)), tuple(rules(jb.papers.SpringRotor))
ROTOR = *BEAM, *OF_ROTOR
NAMES = *ROTOR, "angular_speed"

# One of each kind of equations: linear modal, non-linear modal, elements with an energy and
# without, discrete. In which tier each takes a statement about all models, tests/README.md says.
KINDS = jb.Hybrid, jb.VonKarman, jb.PlanarRod, jb.papers.ANCF, jb.papers.DiscreteNP
# One of each theory of planar elements, those of large deflections as classes, and of the discrete
# analogue.
ELEMENTS = [
    jb.papers.SmallStrainANCF(2),
    jb.PlanarRod(2),
    jb.papers.ANCF(2),
    jb.papers.GreenANCF(2),
    jb.papers.ChordANCF(2),
    jb.papers.TangentANCF(2),
]
THEORIES = [type(model) for model in ELEMENTS[1:]]
DISCRETE = [
    jb.papers.DiscreteNC(),
    jb.papers.DiscreteNP(),
    jb.papers.DiscreteLC(),
    jb.papers.DiscreteLP(),
    jb.papers.DiscreteNS(),
]

# What can model a beam as built, and each with the one that it takes.
YIELDING = [
    jb.Hybrid(3, 4, 3),
    jb.Classical(3, 4, 3),
    jb.VonKarman(5, 3, 2),
]
BUILT = [(model, AS_BUILT) for model in YIELDING]


def name(value: object) -> str:
    """What a parametrised test calls a model; with and without stretch it is another one."""
    if value is AS_BUILT:
        return "as built"
    if isinstance(value, jb.models.AbstractModel):
        return f"{type(value).__name__}{getattr(value, 'n_stretch', '')}"
    return ""


def optimised(function: Callable) -> Callable:
    """`jax.jit`, optimised as the package's own programs are: see tests/compilation.py."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": 1})


def environment(level: int | None = None) -> dict[str, str]:
    """That of a user, without what tests set for themselves but LAPACK's one thread; but with this
    level of optimisation, of which 1 compiles in half the time and runs as fast, or nearly."""
    ours = "XLA_", "JAX_", "EQX_", "MPL", "NPROC"
    users = {key: value for key, value in os.environ.items() if not key.startswith(ours)}
    return users if level is None else users | {"XLA_FLAGS": xla_flags(level)}


def run_optimised(
    *arguments: str | os.PathLike[str], level: int | None = None, timeout: float = 1500.0,
    cwd: os.PathLike[str] | None = None,
) -> str:  # fmt: skip
    """What Python prints with these arguments, in a process of its own with that `environment`."""
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, stdout=subprocess.PIPE, text=True, check=True, timeout=timeout, cwd=cwd,
        env=environment(level),
    ).stdout  # fmt: skip


def finite_difference(f: Callable, x: ArrayLike, relative: float = 2e-3) -> np.ndarray:
    """Jacobian of f at the vector x by six-point central differences, last axis over x.

    Truncation is h^6, round-off eps / h: for functions that vary on the scale of x the best step
    is near eps^(1/7) = 6e-3 relative and the error then near 1e-13 relative.
    """
    x = jnp.asarray(x)
    columns = []
    for i in range(x.size):
        h = relative * float(jnp.abs(x[i]))
        step = jnp.zeros_like(x).at[i].set(h)
        weights = {1: 45, 2: -9, 3: 1}
        total = sum(w * (f(x + k * step) - f(x - k * step)) for k, w in weights.items())
        columns.append(np.asarray(total) / (60 * h))
    return np.stack(columns, -1)


def reverse_mode(function: Callable, outputs: int) -> tuple[Callable, Callable]:
    """A function of a vector, of so many numbers, and its Jacobian by reverse mode: one program for
    both, and row by row, since what is not batched compiles in half the time."""

    @jax.jit
    def pull(x: jax.Array, weights: jax.Array) -> tuple[jax.Array, jax.Array]:
        value, back = jax.vjp(function, x)
        return value, back(weights)[0]

    def value(x: jax.Array) -> jax.Array:
        return pull(x, jnp.zeros(outputs))[0]

    def jacobian(x: jax.Array) -> np.ndarray:
        return np.stack([pull(x, weights)[1] for weights in jnp.eye(outputs)])

    return value, jacobian


def build(parameters: ArrayLike) -> tuple[jb.Rotor, jnp.ndarray]:
    """Rotor and speed from the vector of all parameters, in the order of NAMES."""
    p = jnp.asarray(parameters)
    assert p.shape == (len(NAMES),)  # JAX would take the last number for those beyond
    *rotor, speed = p
    n = len(BEAM)
    return jb.Rotor(jb.Beam(*rotor[:n]), *rotor[n:]), speed


def slender(slenderness: float = 216.2125, hub: float = 0.0, tip: float = 0.0) -> jb.Rotor:
    return jb.Rotor(jb.Beam.from_slenderness(slenderness), hub, tip)
