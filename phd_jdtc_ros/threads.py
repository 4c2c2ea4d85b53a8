"""The number of threads of the linear algebra libraries, which read it when NumPy is imported."""

from __future__ import annotations

import os

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Have this process and its children compute on one thread, unless the user has set another.

    The arrays here are small. Beside other processes, the threads of a BLAS mostly wait for one
    another: a product of a few microseconds can take 80 ms.
    """
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
