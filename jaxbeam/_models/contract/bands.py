"""How matrices of small motion are bands."""

from typing import NamedTuple

import numpy as np


class BandTables(NamedTuple):
    """Matrices of motion as sums over tables, each in a narrow band.

    With the speed g, hub radius R, tip mass m_t and softness EI_zz / (EA L^2) in units of the beam,
    and coefficients c of its `tension` (`_rotor/beam.py`), seven tables make up the stiffness, two
    the mass and two the coupling by Coriolis forces, in this order:

        K = T0 + T1 / softness + c0 T2 + c1 T3 + c2 T4 - g^2 (T5 + m_t T6)
        M = T5 + m_t T6,   C = 2 g (T7 + m_t T8)

    Out of the plane six tables make up

        K = T0 EI_yy / EI_zz + c0 T1 + c1 T2 + c2 T3,   M = T4 + m_t T5.

    Coordinates in the plane, then those out of it, are those of the model in the order `order`;
    `places` are those of the bending functions, by degree, in the plane.
    """

    in_plane: list[np.ndarray]
    flap: list[np.ndarray]
    order: np.ndarray
    places: np.ndarray


class NodeByNode(NamedTuple):
    """Coordinates in the order of nodes: L u' of the first, then w, L w', u, L u' of each.

    Then `Equations.tangents` are block-tridiagonal, and a band of planar motion about the straight
    steady state.
    """

    n_elements: int
    # Whether, in units of the beam, motion depends on speed, hub radius, tip mass and slenderness
    # alone.
    depends_on_four: bool
