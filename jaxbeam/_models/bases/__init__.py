"""Functions along the beam, what of them suits a blade, and what they leave out."""
