"""Theories in finite elements in a plane, in absolute nodal coordinates."""
