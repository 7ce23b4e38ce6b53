"""Tests of the package.

Each worker has a core for itself, and so its LAPACK takes one thread: several would wait for one
another by spinning. OpenBLAS reads this when NumPy is first imported.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
