"""The exact rod in space, which bends both ways, twists, shears and stretches."""
