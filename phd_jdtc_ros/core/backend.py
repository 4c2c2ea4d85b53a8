"""Selection of the inner loops: NumPy, or compiled by numba.

A package of the core with both kinds keeps the compiled loops in its module `compiled`, behind the
same functions. They are used if numba is installed, unless the environment variable
``PHD_JDTC_KERNELS`` selects ``numpy`` or ``numba``; its default is ``auto``.
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
def resolve(wanted: str) -> str:
    """Return the backend for a setting; ``auto`` is numba if it is installed, and otherwise numpy.

    Raises
    ------
    ValueError
        If the setting is unknown.
    ImportError
        If the setting is ``numba`` and numba is not installed.
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


def current() -> str:
    """Return the name of the backend in use: set by `using`, or else by the environment."""
    return _USED.get() or resolve(os.environ.get(VARIABLE, "auto"))


@contextmanager
def using(name: str) -> Iterator[None]:
    """Use the backend of this name within the block."""
    token = _USED.set(resolve(name))
    try:
        yield
    finally:
        _USED.reset(token)


def load(modules: Sequence[str]) -> None:
    """Load modules of the core with compiled loops, if numba is in use.

    A tracker loads them before its first scan, because without a cache on disk their compilation
    takes seconds.
    """
    if current() == NUMBA:
        for module in modules:
            _module(f"{__package__}.{module}")


def compiled(room: str) -> Any:
    """Return the compiled loops of a package of the core; None if NumPy's loops are in use."""
    return _module(f"{__package__}.{room}.compiled") if current() == NUMBA else None


@cache
def _module(name: str) -> Any:
    return importlib.import_module(name)
