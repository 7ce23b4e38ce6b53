"""Theories in functions along the beam."""
