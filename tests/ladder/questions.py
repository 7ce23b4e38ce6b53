"""Rotors with a question about each, by their numbers: what sweeps of the ladder take."""

import equinox as eqx
import numpy as np

import jaxbeam as jb
from tests.helpers import slender

TIMES = np.linspace(0.0, 1.0, 61)


def spin_up(speed, duration, hub=0.0, tip=0.0, slenderness=200.0, kind=jb.ladder.PeakDeflection):
    """Times in units of sqrt(rho L^4 / EI)."""
    rotor = slender(slenderness, hub, tip)
    return rotor, kind(jb.SmoothSpinUp(speed, duration), TIMES * (duration + 1.1))


def steady(gamma, hub):
    """Lowest two frequencies; speeds above a hundred raise."""
    gamma = eqx.error_if(gamma, gamma > 100.0, "too fast")
    return slender(1000.0, hub), jb.ladder.ModalFrequencies(gamma, jb.labels(in_plane=2))
