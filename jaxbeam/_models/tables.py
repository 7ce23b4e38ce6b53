"""Integrals that Cartesian models are made of, over all functions of a model side by side.

Of a uniform beam they are tables for a unit beam, in NumPy, computed once. Where properties vary
along the span, the same integrals get their weights: mass per length over the mass in the place of
one, stiffness as it is at each point.
"""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxbeam._models.basis import Basis, Functions, Rule, bending_integrals, stretch_integrals
from jaxbeam._models.families import Family
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.spanwise import along
from jaxbeam._types import Matrix

Counts = tuple[int, int, int]  # of axial, in-plane and flap functions
# The family of each of these, and where its direction is among the axes.
FAMILIES = (Family.AXIAL, Family.IN_PLANE, Family.FLAP)


class Tables(NamedTuple):
    """Integrals over a beam of unit length and mass, and values at its ends."""

    direction: Float[np.ndarray, "n 3"]  # one-hot: which way a coordinate moves
    tip: Float[np.ndarray, " n"]
    turn: Float[np.ndarray, " n"]  # slope at the tip, of bending functions alone
    root: Float[np.ndarray, " n"]  # slope at the root, of bending functions alone
    elastic: Float[np.ndarray, "3 n n"]  # axial f' f', in plane and flap f'' f''
    gram: Any  # (n, n)
    moment: Any  # (n,)
    first: Any  # (n,), int xi f
    tension: Any  # (3, n, n), bending alone: int t_k f' f', see `Integrals`
    axial_tension: Any  # (3, n, n), the same for the axial coordinates

    def centre(self, rotor: Rotor) -> Any:
        """Values of the functions at the centre of the tip mass, (n,)."""
        if rotor.tip is None:
            return self.tip
        return self.tip + rotor.tip.offset / rotor.beam.length * self.turn


def all_functions(basis: Basis, counts: Counts, xi: np.ndarray) -> Functions:
    """All functions of a model side by side, at points xi."""
    parts = [basis.stretch(counts[0], xi)] if counts[0] else []
    ways = zip(FAMILIES[1:], counts[1:], strict=True)
    parts += [basis.towards(family).bending(n, xi) for family, n in ways if n]
    return Functions(*(np.concatenate(same, 1) for same in zip(*parts, strict=True)))


@functools.lru_cache(maxsize=64)
def sampled(basis: Basis, counts: Counts, edges: tuple[float, ...]) -> tuple[Rule, Functions]:
    """The rule that stops at edges, and all functions at its points."""
    rule = basis.rule(max(counts), edges)
    return rule, all_functions(basis, counts, rule.xi)


@functools.lru_cache(maxsize=64)
def tables(basis: Basis, counts: Counts) -> Tables:
    """Those of a uniform beam, in NumPy."""
    family = np.repeat(np.arange(3), counts)
    direction = np.eye(3)[family]
    xi, w = basis.quadrature(max(counts))
    f = all_functions(basis, counts, xi).value
    gram = f.T @ (w[:, None] * f)
    elastic, tension, axial_tension = (np.zeros((3, family.size, family.size)) for _ in range(3))
    for k, n in enumerate(counts):
        if n == 0:
            continue
        rows = np.ix_(family == k, family == k)
        own = (
            stretch_integrals(basis, n)
            if k == 0
            else bending_integrals(basis.towards(FAMILIES[k]), n)
        )
        gram[rows] = own.mass
        elastic[k][rows] = own.tension[0] if k == 0 else own.curvature
        for table, whole in zip(own.tension, axial_tension if k == 0 else tension, strict=True):
            whole[rows] = table
    tip = all_functions(basis, counts, np.ones(1))
    return Tables(
        direction=direction,
        tip=tip.value[0],
        turn=np.where(family > 0, tip.slope[0], 0.0),
        # Axial functions may have no slope at the clamp: nobody asks for it.
        root=np.where(family > 0, all_functions(basis, counts, np.zeros(1)).slope[0], 0.0),
        elastic=elastic,
        gram=(gram + gram.T) / 2,
        moment=w @ f,
        first=(w * xi) @ f,
        tension=tension,
        axial_tension=axial_tension,
    )


def weighted(basis: Basis, counts: Counts, beam: Beam) -> Tables:
    """Those of a beam, whose mass may vary along the span."""
    known = tables(basis, counts)
    if beam.is_uniform:
        return known
    rule, f = sampled(basis, counts, beam.edges)
    mass = along(beam.mass_per_length, rule.xi)
    share = rule.weight * mass / (rule.weight @ mass)
    # The shapes of `tension` but the first, which is one: int over what lies beyond, of the mass
    # and of its moment.
    beyond = mass / (rule.weight @ mass)
    shapes = (rule.tail @ beyond, rule.tail @ (rule.xi * beyond))
    pulls = jnp.stack([_gram(f.slope, rule.weight * shape) for shape in shapes])
    alike = known.direction @ known.direction.T
    bends = np.outer(known.direction[:, 0] == 0, known.direction[:, 0] == 0)
    return known._replace(
        gram=_gram(f.value, share),
        moment=share @ f.value,
        first=(share * rule.xi) @ f.value,
        tension=jnp.concatenate([known.tension[:1], pulls * (alike * bends)[None]]),
        axial_tension=jnp.concatenate([known.axial_tension[:1], pulls * (alike * ~bends)[None]]),
    )


def linear_stiffness(basis: Basis, counts: Counts, rotor: Rotor) -> Matrix:
    """EA int f' f' dx axially, EI int f'' f'' dx in bending (Y eqs. 9 and 10), and the springs at
    the root.

    With the axes of the section turned by theta, twist and pitch together, bending has
    EI_vv = EI_zz c^2 + EI_yy s^2 and EI_ww = EI_yy c^2 + EI_zz s^2, c = cos(theta) and so on, and
    EI_vw = (EI_zz - EI_yy) s c between the two directions.
    """
    beam, length, known = rotor.beam, rotor.beam.length, tables(basis, counts)
    if beam.is_uniform and rotor.pitch is None:
        rigidity = (
            beam.axial_stiffness / length,
            beam.in_plane_bending_stiffness / length**3,
            beam.flap_bending_stiffness / length**3,
        )
        out: Any = jnp.tensordot(jnp.stack(rigidity), known.elastic, 1)
    else:
        out = _varying_stiffness(basis, counts, rotor)
    return out if rotor.root is None else out + _springs(known, rotor)


def _varying_stiffness(basis: Basis, counts: Counts, rotor: Rotor) -> Matrix:
    beam, length = rotor.beam, rotor.beam.length
    (rule, f), direction = sampled(basis, counts, beam.edges), tables(basis, counts).direction
    stretches = direction[:, 0]
    in_plane = along(beam.in_plane_bending_stiffness, rule.xi)
    flap = along(beam.flap_bending_stiffness, rule.xi)
    stretch = _gram(f.slope * stretches[None], rule.weight * along(beam.axial_stiffness, rule.xi))
    rows = [f.curvature * direction[None, :, k] for k in (1, 2)]
    first, second = (a.T for a in turned(rotor, rule.xi, rows[0].T, rows[1].T))
    bending = _gram(first, rule.weight * in_plane) + _gram(second, rule.weight * flap)
    return stretch / length + bending / length**3


def turned(rotor: Rotor, xi: np.ndarray, in_plane: Any, flap: Any) -> tuple[Any, Any]:
    """Curvatures or slopes (..., p) in the axes of sections, which twist and pitch turn: about that
    of the stiffness in plane, and across."""
    angle = section_angle(rotor, xi)
    if angle is None:
        return in_plane, flap
    cos, sin = jnp.cos(angle)[None], jnp.sin(angle)[None]
    return in_plane * cos + flap * sin, flap * cos - in_plane * sin


def section_angle(rotor: Rotor, xi: np.ndarray) -> Any:
    """The angle by which twist and pitch turn sections, (p,); None where they are not turned."""
    if not rotor.couples_bending:
        return None
    angle = jnp.zeros(xi.size)
    for turn in (rotor.beam.twist, rotor.pitch):
        angle = angle if turn is None else angle + along(turn, xi)
    return angle


def _springs(known: Tables, rotor: Rotor) -> Matrix:
    """Energy k phi^2 / 2, phi = f'(0) q / L."""
    out = jnp.zeros_like(known.elastic[0])
    for k, spring in enumerate(rotor.springs, start=1):
        if spring is not None:
            slope = known.root * known.direction[:, k]
            out = out + spring / rotor.beam.length**2 * np.outer(slope, slope)
    return out


def check_root(model: str, basis: Basis, counts: Counts, rotor: Rotor, coned: bool = False) -> None:
    """Raise `ValueError` unless functions yield at the root where the rotor does, and the beam is
    `coned` only where a model may be."""
    if rotor.precone is not None and not coned:
        raise ValueError(
            f"precone: {model} has no motion of a coned beam: take SpatialANCF, or for frequencies "
            "Hybrid(n_stretch=0); else leave it out, which for soft beams is the smaller error"
        )
    ways = zip(FAMILIES[1:], ("in_plane", "flap"), rotor.springs, counts[1:], strict=True)
    for family, name, spring, count in ways:
        yields = basis.towards(family).yields
        if count and spring is not None and not yields:
            raise ValueError(
                f"root: there is a spring ({name}), and the functions of {model} are clamped: take "
                "model.suited(rotor), whose basis is jaxbeam.models.Hinged"
            )
        if count and spring is None and yields:
            raise ValueError(
                f"root must have a spring ({name}), since the functions of {model} yield there: "
                f"give jaxbeam.RootSprings({name}=...), or take model.suited(rotor)"
            )


def _gram(f: Any, weight: Any) -> Any:
    product = f.T @ (weight[:, None] * f)
    return (product + product.T) / 2


@functools.lru_cache(maxsize=64)
def foreshortening(
    basis: Basis, counts: Counts, xi: tuple[float, ...]
) -> Float[np.ndarray, "p n n"]:
    """int_0^xi f' f' of functions that bend the same way, for a unit beam."""
    family = np.repeat(np.arange(3), counts)
    same = (family[:, None] == family) & (family > 0)
    # Rescaled to [0, xi], a rule stays exact for smooth functions.
    rules = [basis.up_to(max(counts), end) for end in xi]
    points, w = np.stack([rule[0] for rule in rules]), np.stack([rule[1] for rule in rules])
    # All of them at once: of polynomials the recurrences take much longer than the values.
    f = all_functions(basis, counts, points.ravel()).slope.reshape(*points.shape, family.size)
    return f.swapaxes(1, 2) @ (w[:, :, None] * f) * same
