"""Tests of the package, each worker of which takes one core: LAPACK, too, which waits for threads of
its own by spinning. It reads this before anything imports it."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
