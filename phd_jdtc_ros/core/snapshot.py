"""A snapshot: an engine's state as plain arrays and numbers, to be stored and restored.

A snapshot may come from a forged file: every value is checked against what the tracker itself could
have stored, so that none of them ends it or becomes an estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

AnyArray = npt.NDArray[Any]
# The latest stamp that a ROS message can have.
MOST_STAMP_NS = (1 << 31) * 1_000_000_000 - 1
# Of origins and rows; far from where sums of them overflow.
MOST_INDEX = 1 << 60
# By which rounding may make correlations differ from those of a covariance.
ROUNDING = 1e-6


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Return a fact that must be a whole number in [low, high].

    Raises
    ------
    ValueError
        If it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(
            f"{name}: {str(value)[:40]} given, must be a whole number in [{low}, {high}]"
        )
    return value


def require_numbers(name: str, array: AnyArray, low: float, high: float) -> None:
    """Raise ValueError unless all entries are floats in [low, high], and finite."""
    if array.dtype.kind != "f":
        raise ValueError(f"{name}: {array.dtype} given, expected floats")
    if not (np.isfinite(array) & (array >= low) & (array <= high)).all():
        raise ValueError(f"{name}: a number is not finite, or outside [{low:g}, {high:g}]")


def require_whole(name: str, array: AnyArray, low: int, high: int) -> None:
    """Raise ValueError unless all entries are whole numbers in [low, high]."""
    if array.dtype.kind != "i":
        raise ValueError(f"{name}: {array.dtype} given, expected whole numbers")
    if not ((array >= low) & (array <= high)).all():
        raise ValueError(f"{name}: a number is outside [{low}, {high}]")


def require_covariances(name: str, array: AnyArray) -> None:
    """Raise ValueError unless all matrices of finite numbers, (..., D, D), are covariances.

    Axes whose variance is zero are allowed.
    """
    axes = np.arange(array.shape[-1])
    variance = array[..., axes, axes]
    std = np.sqrt(np.maximum(variance, 0.0))
    scale = std[..., None] * std[..., None, :]
    used = scale > 0.0
    correlation = np.where(used, array / np.where(used, scale, 1.0), 0.0)
    turned = correlation.swapaxes(-1, -2)
    if (
        (variance < 0.0).any()
        or array[~used].any()
        or (np.abs(correlation - turned) > ROUNDING).any()
        or np.linalg.eigvalsh(correlation).min(initial=0.0) < -ROUNDING
    ):
        raise ValueError(f"{name}: not a covariance")


@dataclass(frozen=True)
class Snapshot:
    """An engine's state, as data without code.

    Parameters
    ----------
    stamp_ns : int or None
        Stamp of the last scan; None before the first.
    arrays : dict of name to array
        By dotted name.
    facts : dict
        Values that JSON can represent: numbers, strings, lists and dicts.
    """

    stamp_ns: int | None
    arrays: dict[str, AnyArray] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str) -> AnyArray:
        """Return a stored array.

        Raises
        ------
        ValueError
            If there is no array of this name.
        """
        if name not in self.arrays:
            raise ValueError(f"{name}: missing")
        return self.arrays[name]
