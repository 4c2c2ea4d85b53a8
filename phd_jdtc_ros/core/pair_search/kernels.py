"""The searches' inner loops: plain or compiled, by the backend in use.

Both kinds of `near_pairs` and `near_detections` add the same numbers in the same order and so
return the same bits. The compiled `kernel_within_groups` evaluates the backward kernel as well; its
values differ in their last digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from .. import backend
from ..arrays import FloatArray, IntArray
from .gating import near_detections
from .plain import near_pairs


@dataclass(frozen=True)
class Kernels:
    """The inner loops of one kind.

    Parameters
    ----------
    near_pairs : callable
        See `plain.near_pairs`.
    layout : "C" or "F"
        Memory order of the coordinates, (K, N): NumPy gathers one axis after the other, compiled
        code reads all axes of a point.
    near_detections : callable
        See `gating.near_detections`.
    kernel_within_groups : callable or None
        See `compiled_kernel`; if None, `grid` finds the pairs.
    """

    name: str
    near_pairs: Callable[
        [FloatArray, FloatArray, FloatArray, IntArray, IntArray, IntArray],
        tuple[IntArray, IntArray, FloatArray],
    ]
    layout: Literal["C", "F"]
    near_detections: Callable[..., tuple[IntArray, IntArray, FloatArray]]
    kernel_within_groups: Callable[..., tuple[FloatArray, Any, Any, FloatArray]] | None


def current() -> Kernels:
    """Return the kernels of the backend in use."""
    return _of(backend.current())


@cache
def _of(name: str) -> Kernels:
    if name == backend.NUMPY:
        return Kernels(name, near_pairs, "C", near_detections, None)
    from . import compiled, compiled_kernel

    return Kernels(
        name,
        compiled.near_pairs,
        "F",
        compiled.near_detections,
        compiled_kernel.kernel_within_groups,
    )
