"""The kinds of inner loops that are installed, by the names that tables show."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager

from phd_jdtc_ros.core import backend as core

NUMPY = "NumPy"
NUMBA = "numba"


@functools.cache
def available() -> tuple[str, ...]:
    """Return the names of the installed backends, the reference first."""
    try:
        core.resolve(NUMBA)
    except ImportError:
        return (NUMPY,)
    return (NUMPY, NUMBA)


def reason_missing(backend: str) -> str:
    """Return why a backend is not available."""
    return f"{backend} is not installed: pip install numba"


def using(backend: str) -> AbstractContextManager[None]:
    """Use one of them for as long as the block lasts."""
    return core.using(backend.lower())
