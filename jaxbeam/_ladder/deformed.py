"""How far a beam deforms, in the numbers that every answer has."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.spanwise import along, beside_kinks

END = (0.99, 1.0)  # places x / L between which the slope at the tip is taken


def straightened(rotor: Rotor) -> Rotor:
    """The rotor for theories of straight beams: with the straight beam of a blade, and clamped in
    the place of supports."""
    ends = (rotor.root_support, rotor.tip_support)
    if any(end is not None for end in ends):
        rotor = dataclasses.replace(rotor, root_support=None, tip_support=None)
    if isinstance(rotor.beam, Blade):
        rotor = dataclasses.replace(rotor, beam=rotor.beam.beam())
    return rotor


def strained_most(rotor: Rotor) -> np.ndarray:
    """Places x / L at which strains may be largest: the root, and where the beam is weaker."""
    beam = rotor.beam
    return np.zeros(1) if beam.is_uniform else np.append(0.0, beside_kinks(beam.edges)[0])


def deformed_by(rotor: Rotor, ends: Array, strain: Array, curvature: Array) -> tuple[Array, ...]:
    """`size`, `slope` and `constitutive_uncertainty` of an `Answer`, from displacements (T, 2, 3)
    at `END`, strains (T, p) and curvatures (T, p, 2) where the beam is strained most."""
    beam, places = rotor.beam, strained_most(rotor)
    size = jnp.max(jnp.linalg.norm(ends[:, 1, 1:], axis=1)) / beam.length
    rise = jnp.linalg.norm(ends[:, 1, 1:] - ends[:, 0, 1:], axis=1)
    slope = jnp.max(rise) / ((END[1] - END[0]) * beam.length)
    both = (beam.in_plane_bending_stiffness, beam.flap_bending_stiffness)
    stiffness = jnp.stack([along(each, places) for each in both], 1)
    stiffness = stiffness / along(beam.axial_stiffness, places)[:, None]
    bent = jnp.sum(curvature**2 * stiffness[None], 2)
    return size, slope, jnp.max(jnp.abs(strain)) + jnp.max(bent)
