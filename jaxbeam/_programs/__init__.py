"""Programs made fast: kernels over lanes, batches, loops whose batches wait for nobody. No word of
beams."""
