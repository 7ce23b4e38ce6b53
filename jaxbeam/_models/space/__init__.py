"""Finite elements in space, which bend both ways, twist and stretch."""
