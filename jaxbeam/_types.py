"""Shapes that recur in signatures, under one name each."""

from jaxtyping import Array, Complex, Float, Int

Scalar = Float[Array, ""]
Real = float | Scalar  # what a user may give where a scalar is wanted
Code = Int[Array, ""]
Matrix = Float[Array, "n n"]
Vectors = Complex[Array, "k n"]
