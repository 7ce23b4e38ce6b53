"""diffrax solvers that use the structure of M q'' = force(t, q, q')."""
