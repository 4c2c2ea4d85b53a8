"""The time axis of a run: time since its first stamp, in a unit that suits its length."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .record import Record


@dataclass(frozen=True)
class Clock:
    """Converts stamps to the time since a run's first stamp."""

    origin_ns: int
    span_s: float

    @staticmethod
    def of(record: Record) -> Clock:
        """Return the clock that starts with the record's first stamp."""
        parts: tuple[Iterable[Any], ...] = (
            record.truth,
            record.plots,
            record.filtered,
            record.smoothed,
        )
        stamps = [item.stamp_ns for part in parts for item in part]
        if not stamps:
            return Clock(0, 0.0)
        return Clock(min(stamps), (max(stamps) - min(stamps)) * 1e-9)

    @property
    def unit(self) -> str:
        """The unit: ``s``, or ``min`` for runs of more than half an hour."""
        return "s" if self.span_s <= 1800.0 else "min"

    @property
    def unit_s(self) -> float:
        """Length of the unit, seconds."""
        return 1.0 if self.unit == "s" else 60.0

    def seconds(self, stamp_ns: Sequence[int]) -> FloatArray:
        """Return seconds from the origin; the difference is taken in integers."""
        elapsed_ns = np.array([stamp - self.origin_ns for stamp in stamp_ns], dtype=np.int64)
        return elapsed_ns.astype(float) * 1e-9

    def number(self, seconds: float) -> str:
        """Return a time without its unit."""
        return f"{round(seconds / self.unit_s, 1):g}"

    def text(self, seconds: float) -> str:
        """Return a time with its unit."""
        return f"{self.number(seconds)} {self.unit}"

    def interval(self, first_s: float, last_s: float) -> str:
        """Return two times with their unit."""
        return f"{self.number(first_s)} to {self.text(last_s)}"
