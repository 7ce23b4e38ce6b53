"""Linear algebra that knows structure, and programs made fast; no word of beams."""
