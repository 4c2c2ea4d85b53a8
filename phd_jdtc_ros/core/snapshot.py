# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A snapshot: an engine's state as plain arrays and numbers, to be stored and restored."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt

# The latest stamp that a ROS message can have.
MOST_STAMP_NS = (1 << 31) * 1_000_000_000 - 1


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
    arrays: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str) -> npt.NDArray[Any]:
        """Return a stored array.

        Raises
        ------
        ValueError
            If there is no array of this name.
        """
        if name not in self.arrays:
            raise ValueError(f"{name}: missing")
        return self.arrays[name]
