"""Random scenes: every outcome is a finite answer in balance, or says what is wrong.

Hypothesis draws the numbers of scenes whose static parts (model, motion, solver) are few, since
each of these compiles for seconds. Most scenes are sensible: slender beams, with speeds, times and
forces in units of their own. In some, one or two numbers are zero, negative, not finite, or absurd.

A failure prints its scene, and a line that makes Hypothesis draw it again. In CI the scenes are
few, and the same in every run; the exhaustive tier draws new ones, by the thousand. For more:

    FUZZ_FACTOR=20 python -m pytest -m exhaustive tests/fuzz
"""
