"""An engine that smooths whole sets, whichever targets a scan has swept."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from ..tracks.common_stamp import at_stamp
from ..types import Estimates
from .entries import Entry, LinkT, RowsT
from .fixed_lag import FixedLagEngine
from .window_rows import interpolation_stamps, rows_at


class SetSmoother(FixedLagEngine[RowsT, LinkT]):
    """Smooths the sets of all scans in the window, and extracts the targets at a stamp."""

    @abstractmethod
    def _backward(self, window: Sequence[Entry[RowsT, LinkT]]) -> Sequence[RowsT]:
        """Return the smoothed sets of a window, newest first; the window is oldest first.

        A source that is not in the window has been dropped; nothing is sent to it.
        """

    def _smoothed_at(self, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        alive = rows_at(self._window, self.forward.unswept, stamp_ns)
        backward = self._backward(self._window)
        self.forward.on_stage_end("backward")
        sets = {
            entry.stamp_ns: smoothed
            for entry, smoothed in zip(reversed(self._window), backward, strict=True)
        }
        if alive.keys() == {stamp_ns}:
            return self._extract(sets[stamp_ns], stamp_ns, lag, threshold)
        stamps = interpolation_stamps(self._window, stamp_ns, alive)
        if not stamps:
            return self._empty(stamp_ns, lag)
        extracted = []
        for entry_ns in stamps:
            stored, rows = sets[entry_ns], alive.get(entry_ns)
            estimates = self._extract(stored, entry_ns, lag, 0.0)
            if rows is not None:
                is_alive = np.isin(estimates.track_id - 1, stored.row_label[rows])
                estimates = estimates.select(is_alive)
            extracted.append(estimates)
        modes = self.forward.model.modes
        return at_stamp(*Estimates.concatenate(extracted, lag), stamp_ns, threshold, modes)
