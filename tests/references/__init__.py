"""Independent solvers, against which the package is held: nothing here imports it.

Each derives its own equations and solves them by a method that the package does not use, so that
the two have no mistake in common.
"""
