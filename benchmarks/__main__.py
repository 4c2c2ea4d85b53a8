"""``python -m benchmarks``: on one thread, which must be set before numpy is imported."""

import os
import sys

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"
os.environ["NUMBA_NUM_THREADS"] = "1"

from .command import main

sys.exit(main(sys.argv[1:]))
