# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The searches' inner loops: plain or compiled, and which of the two is in use.

Both kinds of `near_pairs` and `near_detections` add the same numbers in the same order and so
return the same bits. The compiled `kernel_within_groups` evaluates the backward kernel as well; its
values differ in their last digits. Compiled loops are used where numba is installed, unless the
environment variable ``PHD_JDTC_KERNELS`` says otherwise: ``numpy`` or ``numba``, by default
``auto``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from ..arrays import FloatArray, IntArray
from .gating import near_detections
from .plain import near_pairs

VARIABLE = "PHD_JDTC_KERNELS"


@dataclass(frozen=True)
class Kernels:
    """The inner loops of one kind.

    Parameters
    ----------
    name : str
    near_pairs : callable
        As that of `plain`.
    layout : "C" or "F"
        Memory order of the coordinates, (K, N): NumPy gathers one axis after the other, compiled
        code reads all axes of a point.
    near_detections : callable
        As that of `gating`.
    kernel_within_groups : callable or None
        That of `compiled_kernel`; without one, `grid` finds the pairs.
    """

    name: str
    near_pairs: Callable[
        [FloatArray, FloatArray, FloatArray, IntArray, IntArray, IntArray],
        tuple[IntArray, IntArray, FloatArray],
    ]
    layout: Literal["C", "F"]
    near_detections: Callable[..., tuple[IntArray, IntArray, FloatArray]]
    kernel_within_groups: Callable[..., tuple[FloatArray, Any, Any, FloatArray]] | None


NUMPY = Kernels("numpy", near_pairs, "C", near_detections, None)
_USED: ContextVar[Kernels | None] = ContextVar("kernels", default=None)


@cache
def kernels(wanted: str) -> Kernels:
    """Return the kernels of this name; ``auto`` is numba where it is installed, or else numpy.

    Raises
    ------
    ValueError
        If there are none of this name.
    ImportError
        If numba is asked for and not installed.
    """
    if wanted not in ("auto", "numpy", "numba"):
        raise ValueError(f"{VARIABLE}: {wanted!r} given, must be auto, numpy or numba")
    if wanted == "numpy":
        return NUMPY
    try:
        from . import compiled, compiled_kernel
    except ImportError:
        if wanted == "numba":
            raise
        return NUMPY
    return Kernels(
        "numba",
        compiled.near_pairs,
        "F",
        compiled.near_detections,
        compiled_kernel.kernel_within_groups,
    )


def chosen() -> Kernels:
    """Return the kernels in use: those of `using`, or else what the environment says."""
    return _USED.get() or kernels(os.environ.get(VARIABLE, "auto"))


@contextmanager
def using(name: str) -> Iterator[None]:
    """Use the kernels of this name for as long as the block lasts."""
    token = _USED.set(kernels(name))
    try:
        yield
    finally:
        _USED.reset(token)
