"""What follows from a model linearised about steady or periodic rotation."""
