# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The installed backends of the neighbour search's inner loops.

`phd_jdtc_ros.core.pair_search.sweep` chooses a backend when it is imported. A comparison in one
process has to change that choice, which only this module does.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager

from phd_jdtc_ros.core.pair_search import sweep

NUMPY = "NumPy"
NUMBA = "numba"


@functools.cache
def available() -> tuple[str, ...]:
    """Return the names of the installed backends, the reference first."""
    try:
        sweep.backend(NUMBA)
    except ImportError:
        return (NUMPY,)
    return (NUMPY, NUMBA)


def reason_missing(backend: str) -> str:
    """Return why a backend is not available."""
    return f"{backend} is not installed: pip install '.[fast]'"


@contextmanager
def using(backend: str) -> Iterator[None]:
    """Use a backend within the context."""
    chosen = sweep.BACKEND
    sweep.BACKEND = sweep.backend(backend.lower())
    try:
        yield
    finally:
        sweep.BACKEND = chosen
