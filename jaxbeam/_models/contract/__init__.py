"""What a model is: equations of motion, matrices, loads on them, and their equilibrium."""
