"""Beams and rotors that several test modules share, those of the two papers among them; SI units.

B is Berzeri and Shabana 1999, Y is Yoo, Ryan and Scott 1995.
"""

import dataclasses

import numpy as np

import jaxbeam as jb

# --- of the papers -------------------------------------------------------------------------------

# The aluminium beam of B Table 1, column "Ref. 21": what `Beam.from_section` takes.
ALUMINIUM_SECTION = {
    "length": 8.0, "youngs_modulus": 6.895e10, "density": 2767.0, "area": 7.299e-5,
    "in_plane_second_moment": 8.214e-9,
}  # fmt: skip
ALUMINIUM = jb.Beam.from_section(**ALUMINIUM_SECTION)
README_ROTOR = jb.Rotor(ALUMINIUM, 0.5, 0.1)  # of the first example of README.md
# Y Figs. 3 and 4; 5 and 6; 7 and 8; 12 to 14.
ABRUPT = jb.Rotor(jb.Beam(30.5, 550.0, 6.89e9 * 9.29e-2, 6.89e9 * 7.19e-4, 6.89e9 * 7.19e-4))
SMOOTH = jb.Rotor(jb.Beam(10.0, 1.2, 7e10 * 4e-4, 7e10 * 2e-7, 7e10 * 2e-7))
SPATIAL = jb.Rotor(jb.Beam(10.0, 1.2, 7e10 * 4e-4, 7e10 * 4e-7, 7e10 * 2e-7))
PAPER_SPRINGS = jb.papers.SpringRotor(1.0, 1.0, 1.0, 6e5, 300.0)

# --- made up -------------------------------------------------------------------------------------

# The aluminium beam in round numbers.
ROUND = jb.Beam(8.0, 0.2, 5e6, 566.0, 566.0)
SPRINGS = jb.papers.SpringRotor(1.3, 0.8, 0.4, 6000.0, 30.0)
SOFT_SPRINGS = jb.papers.SpringRotor(1.3, 0.8, 0.4, 600.0, 30.0)
TORSION = {"torsional_stiffness": 6.0, "polar_inertia": 0.03}  # of `short`, for models in space


def short(axial_stiffness: float = 4e4, **more: float) -> jb.Beam:
    """A beam none of whose numbers are one or alike: what is mixed up shows."""
    return jb.Beam(2.0, 1.3, axial_stiffness, 11.0, 7.0, **more)


# A beam as built, with all that modal models can do.
AS_BUILT = jb.Rotor(
    jb.Beam(
        2.0,
        jb.Spanwise([0, 0.3, 0.3, 1], [1.6, 1.2, 1.0, 0.7]),
        jb.blades.SpanwiseFunction(lambda x: 4e3 * (1 - x / 2)),
        jb.Spanwise([0, 0.6, 1], [14.0, 9.0, 5.0]),
        jb.Spanwise([0, 0.3, 0.3, 1], [8.0, 7.0, 5.0, 3.0]),
        twist=jb.Spanwise([0, 1], [0.4, -0.1]),
        torsional_stiffness=jb.Spanwise([0, 0.3, 0.3, 1], [6.0, 5.0, 4.0, 3.0]),
        polar_inertia=jb.Spanwise([0, 1], [0.02, 0.01]),
        point_masses=jb.PointMasses([0.45, 0.7], [0.2, 0.1]),
    ),
    hub_radius=0.4,
    pitch=0.2,
    root_springs=jb.RootSprings(in_plane=40.0, flap=25.0),
    tip_body=jb.TipBody(0.3, offset=0.1, inertia=0.02, axial_inertia=0.005, flap_inertia=0.03),
)


def without_rotary_inertia(rotor: jb.Rotor) -> jb.Rotor:
    """A rotor as elements have it where sections turn, which modal theories are held against."""
    return dataclasses.replace(rotor, beam=dataclasses.replace(rotor.beam, polar_inertia=None))


def soft_tipped() -> jb.blades.Blade:
    """A blade whose tip is a million times as soft as its root, as real ones are."""
    stations, share = [0.0, 0.5, 0.9, 0.98, 1.0], np.array([1.0, 0.1, 3e-3, 3e-4, 1e-6])
    stiffness = share[:, None, None] * np.diag([1e9, 2e8, 2e8, 2e7, 8e7, 3e8])
    inertia = np.sqrt(share)[:, None, None] * np.diag([100.0, 100, 100, 50, 10, 40])
    return jb.blades.Blade(stations, stiffness, inertia, 40.0)
