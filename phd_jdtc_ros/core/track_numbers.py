# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Track numbers: small, in the order in which tracks are first reported."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .arrays import IntArray
from .types import Estimates


class TrackNumbers:
    """Maps labels to track numbers, in the order in which tracks are first reported.

    Parameters
    ----------
    number : dict of label to number, or None
        The numbers in use.
    count : int
        The last number given; the first is 1.
    """

    def __init__(self, number: dict[int, int] | None = None, count: int = 0) -> None:
        self._number = number or {}
        self.count = count

    def numbered(self, estimates: Estimates) -> Estimates:
        """Return the estimates with track numbers for labels; 0 stays 0."""
        numbers = [self._track(label) if label else 0 for label in estimates.track_id.tolist()]
        return replace(estimates, track_id=np.array(numbers, dtype=np.int64))

    def _track(self, label: int) -> int:
        if label not in self._number:
            self.count += 1
            self._number[label] = self.count
        return self._number[label]

    @property
    def in_use(self) -> dict[int, int]:
        """The number of each label; a copy."""
        return dict(self._number)

    @property
    def facts(self) -> dict[str, Any]:
        """The state for a snapshot: the arguments that make an equal one."""
        return {"number": [list(pair) for pair in self._number.items()], "count": self.count}

    def forget_all_but(self, labels: list[IntArray]) -> None:
        """Drop the numbers of targets that can no longer be reported."""
        alive = set((np.concatenate(labels) + 1).tolist())
        self._number = {label: n for label, n in self._number.items() if label in alive}


class NoNumbers(TrackNumbers):
    """Leaves labels as they are, while it is not known yet which of them have a number."""

    def numbered(self, estimates: Estimates) -> Estimates:
        """Return the estimates as they are."""
        return estimates

    def forget_all_but(self, labels: list[IntArray]) -> None:
        """Do nothing."""
