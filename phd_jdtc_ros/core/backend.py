"""Which inner loops are in use: those of NumPy, or those that numba compiles.

A room of the core that has both kinds keeps the compiled ones in its module `compiled`, behind the
same functions. They are used where numba is installed, unless the environment variable
``PHD_JDTC_KERNELS`` says otherwise: ``numpy`` or ``numba``, by default ``auto``.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

VARIABLE = "PHD_JDTC_KERNELS"
NUMPY, NUMBA = "numpy", "numba"
_USED: ContextVar[str | None] = ContextVar("backend", default=None)


@cache
def resolved(wanted: str) -> str:
    """Return the backend of this name; ``auto`` is numba where it is installed, or else numpy.

    Raises
    ------
    ValueError
        If there is none of this name.
    ImportError
        If numba is asked for and not installed.
    """
    if wanted not in ("auto", NUMPY, NUMBA):
        raise ValueError(f"{VARIABLE}: {wanted!r} given, must be auto, numpy or numba")
    if wanted == NUMPY:
        return NUMPY
    try:
        importlib.import_module(f"{__package__}.numba_loops")
    except ImportError:
        if wanted == NUMBA:
            raise
        return NUMPY
    return NUMBA


def chosen() -> str:
    """Return the name of the backend in use: that of `using`, or else what the environment says."""
    return _USED.get() or resolved(os.environ.get(VARIABLE, "auto"))


@contextmanager
def using(name: str) -> Iterator[None]:
    """Use the backend of this name for as long as the block lasts."""
    token = _USED.set(resolved(name))
    try:
        yield
    finally:
        _USED.reset(token)


def load(modules: Sequence[str]) -> None:
    """Load modules of the core with compiled loops, if numba is in use.

    Where none of their code is stored on disk yet they are compiled, which takes seconds: a tracker
    loads them before its first scan.
    """
    if chosen() == NUMBA:
        for module in modules:
            _module(f"{__package__}.{module}")


def compiled(room: str) -> Any:
    """Return the compiled loops of a room of the core; None if those of NumPy are in use."""
    return _module(f"{__package__}.{room}.compiled") if chosen() == NUMBA else None


@cache
def _module(name: str) -> Any:
    return importlib.import_module(name)
