"""What rotates, how its hub moves, and what acts on it: the data of a scene."""
