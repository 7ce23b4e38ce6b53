"""Modes of vibration about steady rotation: by bands, dense, about loaded states, and their
labels."""
