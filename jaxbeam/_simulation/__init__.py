"""Motions in time: a model on a moving hub, integrated."""
