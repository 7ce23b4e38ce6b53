"""Shapes that recur in signatures, under one name each."""

from jaxtyping import Array, Complex, Float, Int

Scalar = Float[Array, ""]
Code = Int[Array, ""]
Matrix = Float[Array, "n n"]
Vectors = Complex[Array, "k n"]
