"""Which model is cheap enough and still right."""
