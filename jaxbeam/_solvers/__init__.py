"""Integrators in time of systems M(t) q'' = f(t, q, q') that exploit their structure."""
