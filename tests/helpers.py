"""Tools shared by the tests."""

import os
from collections.abc import Callable
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

import jaxbeam as jb

NAMES = (
    "length",
    "mass_per_length",
    "axial_stiffness",
    "in_plane_bending_stiffness",
    "flap_bending_stiffness",
    "hub_radius",
    "tip_mass",
    "angular_speed",
)

# The environment of a user: without what the tests set for themselves (see conftest.py).
USERS = {k: v for k, v in os.environ.items() if not k.startswith(("XLA_", "JAX_", "EQX_", "MPL"))}
# With it the compiler takes half as long; releases that do not know it end the process.
OLD_EMITTERS = (
    ["--xla_cpu_use_fusion_emitters=false"] if version("jaxlib").startswith("0.10.") else []
)
# The same with programs that are compiled in half the time and run as fast, or nearly.
HASTY = {**USERS, "XLA_FLAGS": " ".join(["--xla_backend_optimization_level=1", *OLD_EMITTERS])}

# One of each theory of planar elements, and of the discrete analogue.
ELEMENTS = [
    jb.models.SmallStrainANCF(2),
    jb.ANCF(2),
    jb.EngineeringANCF(2),
    jb.GreenANCF(2),
    jb.models.ChordANCF(2),
    jb.models.TangentANCF(2),
]
DISCRETE = [
    jb.models.DiscreteNC(),
    jb.models.DiscreteNP(),
    jb.models.DiscreteLC(),
    jb.models.DiscreteLP(),
    jb.models.DiscreteNS(),
]


def name(value: object) -> str:
    """What a parametrised test calls a model; with and without stretch it is another one."""
    if isinstance(value, jb.models.AbstractModel):
        return f"{type(value).__name__}{getattr(value, 'n_stretch', '')}"
    return ""


def optimised(function: Callable) -> Callable:
    """`jax.jit` for what runs longer than it compiles: otherwise tests compile without LLVM's
    optimisation (see conftest.py)."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": 3})


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


def build(parameters: ArrayLike) -> tuple[jb.Rotor, jnp.ndarray]:
    """Rotor and speed from the vector of all parameters, in the order of NAMES."""
    p = jnp.asarray(parameters)
    return jb.Rotor(jb.Beam(*p[:5]), p[5], p[6]), p[7]


def slender(slenderness: float = 216.2125, hub: float = 0.0, tip: float = 0.0) -> jb.Rotor:
    return jb.Rotor(jb.Beam.from_slenderness(slenderness), hub, tip)
