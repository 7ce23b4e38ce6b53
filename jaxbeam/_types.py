"""Shapes that recur in signatures, under one name each."""

from jaxtyping import Array, Complex, Float, Int

Scalar = Float[Array, ""]
Real = float | Scalar  # what a user may give where a scalar is wanted
Code = Int[Array, ""]
Matrix = Float[Array, "n n"]
Vector = Float[Array, " n"]  # one number a coordinate
Vectors = Complex[Array, "k n"]
Triple = Float[Array, " 3"]  # components along a1 (the beam), a2 (in plane), a3 (the axis)
