"""Sections of a `Beam` as diagonal matrices about its straight axis."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._rotor.beam import Beam
from jaxbeam._rotor.sections import AbstractSections, Places
from jaxbeam._rotor.span import polar_inertia, shared
from jaxbeam._rotor.spanwise import AbstractSpanwise, Property, Spanwise, along

# Compliance of shear over L^2 / EI: a beam has none, but elements need some. Relative changes of
# frequencies by it are some ten times that, in the third mode a hundred times.
STIFF_IN_SHEAR = 1e-8


def sections_of(beam: Beam | AbstractSections) -> AbstractSections:
    """The sections of a beam as matrices of six by six, for elements of rods."""
    return beam if isinstance(beam, AbstractSections) else BeamSections(beam)


class BeamSections(AbstractSections):
    """Sections of a `Beam`: without offsets and couplings, and nearly without shear. The moments of
    inertia about the two axes across are in the ratio of the bending stiffnesses, as of a solid
    section; their sum is the polar one."""

    beam: Beam

    @property
    def _varying(self) -> list[AbstractSpanwise]:
        """Properties that vary along the span; the mass without that at points."""
        beam = self.beam
        names = (
            "mass_per_length", "axial_stiffness", "in_plane_bending_stiffness",
            "flap_bending_stiffness", "twist", "torsional_stiffness", "polar_inertia",
        )  # fmt: skip
        every = (getattr(beam, name) for name in names)
        return [value for value in every if isinstance(value, AbstractSpanwise)]

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(sorted({step for value in self._varying for step in value.steps}))

    @property
    def edges(self) -> tuple[float, ...]:
        return (0.0, *sorted({kink for value in self._varying for kink in value.kinks}), 1.0)

    @property
    def has_functions(self) -> bool:
        """Whether something is given by a function rather than by a table."""
        return any(not isinstance(value, Spanwise) for value in self._varying)

    def axis_at(self, places: Places) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
        along = self.beam.length[None] * np.eye(3)[0]
        return jnp.asarray(places)[:, None] * along[None], jnp.broadcast_to(along, (len(places), 3))

    def twist_at(self, places: Places) -> Float[Array, " m"]:
        twist = self.beam.twist
        return jnp.zeros(len(places)) if twist is None else along(twist, places)

    def compliance_at(self, places: Places) -> Float[Array, "m 6 6"]:
        return _diagonal(*(1 / entry for entry in self._stiffnesses(places)))

    def stiffness_at(self, places: Places) -> Float[Array, "m 6 6"]:
        return _diagonal(*self._stiffnesses(places))

    def inertia_at(self, places: Places) -> Float[Array, "m 6 6"]:
        beam = self.beam

        def values(value: Property) -> Array:
            return along(value, places)

        mass, polar = values(beam.mass_per_length), polar_inertia(beam, values)
        lag, flap = shared(polar, beam, values)
        return _diagonal(mass, mass, mass, polar, flap, lag)

    def _stiffnesses(self, places: Places) -> tuple[Array, ...]:
        beam = self.beam
        lag, flap = self._bending(places)
        # Each shear stiffness is in proportion to the bending in the same plane. If both went with
        # the stiff bending of a strip, the soft one would be lost in rounding.
        by_bending = STIFF_IN_SHEAR * beam.length**2
        stretch, torsion = (
            along(value, places) for value in (beam.axial_stiffness, beam.torsional_stiffness)
        )
        return stretch, lag / by_bending, flap / by_bending, torsion, flap, lag

    def _bending(self, places: Places) -> tuple[Array, Array]:
        """Stiffnesses of bending in plane and in flap."""
        beam = self.beam
        both = beam.in_plane_bending_stiffness, beam.flap_bending_stiffness
        lag, flap = (along(value, places) for value in both)
        return lag, flap


def _diagonal(*entries: Any) -> Float[Array, "m 6 6"]:
    rows: Any = jnp.stack(entries, 1)[:, :, None] * np.eye(6)[None]
    return rows
