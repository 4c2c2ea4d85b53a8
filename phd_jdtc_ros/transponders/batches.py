"""Collects the reports of a while to a batch, and converts it to the columns of a cloud."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .messages import NAME_SIZE, NONE, Heard
from .transmitters import Dated

# Marks an unknown address in a cloud.
UNKNOWN = 2**32 - 1
# Columns of double precision.
WIDE = ("latitude", "longitude", "time")
_ELLIPSE = ("x_std", "y_std", "correlation")


class Batch(NamedTuple):
    """Reports that came within a period."""

    stamp_ns: int  # When the last of them came
    reports: list[Dated]


class Batches:
    """Collects reports; a batch ends a period after its first report."""

    # Upper bound of the reports of a batch.
    MOST = 10_000

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._pending: list[Dated] = []
        self._first_ns = self._last_ns = 0

    def add(self, report: Dated, came_ns: int) -> Batch | None:
        """Add a report, and return the batch that has ended before it."""
        full = len(self._pending) >= self.MOST
        ended = self.finish() if full or abs(came_ns - self._first_ns) >= self._period_ns else None
        if not self._pending:
            self._first_ns = came_ns
        self._pending.append(report)
        self._last_ns = came_ns
        return ended

    def due(self, now_ns: int) -> Batch | None:
        """Return the batch that has ended by a time, None if none has."""
        return self.finish() if abs(now_ns - self._first_ns) >= self._period_ns else None

    def finish(self) -> Batch | None:
        """Return the reports that wait, None without any."""
        if not self._pending:
            return None
        # Stamps rise with the reports, which have their own times.
        found, self._pending = self._pending, []
        return Batch(self._last_ns, found)


def columns(batch: Batch, ellipses: bool = False) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a cloud in their order, arrays of shape (M,); unknown numbers are NaN.

    They are ``latitude longitude`` (degrees), ``time`` (s since the epoch), ``speed`` (m/s),
    ``course heading`` (degrees clockwise from true north), ``height`` (m), ``std`` of each axis, or
    with `ellipses` ``x_std y_std correlation`` (m, east and north); ``length beam`` of a ship, and
    the antenna's place ``ahead left`` of her middle (m); ``address`` (`UNKNOWN` without one),
    ``space``, ``interval`` (the shortest one of such a transmitter, s), ``type`` (0 if unknown),
    ``accurate`` (255 if unknown), and ``name``, shape (M, `NAME_SIZE`), ASCII padded with zeros.
    """
    found = [report.heard for report in batch.reports]
    by_name = dict(zip(Heard._fields, zip(*found, strict=True), strict=True))

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(by_name[name], dtype=np.float64)

    def small(name: str) -> npt.NDArray[np.uint8]:
        return np.array(by_name[name]).clip(0, 255).astype(np.uint8)

    std = _ELLIPSE if ellipses else ("x_std",)
    hulls = np.array([_hull(each) for each in found])
    address = column("address")
    return {
        "latitude": column("latitude"),
        "longitude": column("longitude"),
        "time": np.array([report.time_ns for report in batch.reports]) * 1e-9,
        **{name: column(name) for name in ("speed", "course", "heading", "height")},
        **{name if ellipses else "std": column(name) for name in std},
        **{name: hulls[:, k] for k, name in enumerate(("length", "beam", "ahead", "left"))},
        "address": np.where(address == NONE, UNKNOWN, address).astype(np.uint32),
        "space": small("space"),
        "interval": column("interval_s"),
        "type": small("type"),
        "accurate": small("accurate"),
        "name": _names(by_name["name"]),
    }


def _hull(heard: Heard) -> tuple[float, float, float, float]:
    """Return length and beam of a ship, and how far ahead and left of her middle the antenna is."""
    if heard.hull is None:
        return (math.nan,) * 4
    bow, stern, port, starboard = heard.hull
    length, beam = float(bow + stern), float(port + starboard)
    if not (bow or port):  # The antenna's place is unknown
        return length, beam, math.nan, math.nan
    return length, beam, 0.5 * (stern - bow), 0.5 * (starboard - port)


def _names(names: tuple[str, ...]) -> npt.NDArray[np.uint8]:
    text = [name.encode("ascii", "replace")[:NAME_SIZE].ljust(NAME_SIZE, b"\0") for name in names]
    return np.frombuffer(b"".join(text), dtype=np.uint8).reshape(-1, NAME_SIZE)
