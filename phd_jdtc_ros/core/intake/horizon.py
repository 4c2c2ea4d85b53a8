"""Estimates the end of the interval of time that each report of a radar covers.

Radars stamp a report at the end of its sector, in the middle of its turn, or when it is sent. The
detections' own times show which of these a radar does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray

# Reports of this many turns are remembered, and at least this many reports.
TURNS, REPORTS = 4.0, 8
# A radar is regular if the median relative deviation of its report intervals is below REGULAR;
# fewer than LEAST_STEPS intervals count as regular.
REGULAR, LEAST_STEPS = 0.15, 4
# Detections farther than this beyond the expected end of a report do not move it, in report
# intervals and in turns.
BEYOND, BEYOND_TURNS = 0.75, 0.06


class Horizon(NamedTuple):
    """Timing of the latest reports of a radar, from which the next one's is predicted.

    Parameters
    ----------
    lays : array of shape (K, 3)
        For each report, oldest first, seconds: its stamp, its first detection's time after the
        previous stamp, and its last detection's time after its own stamp; NaN without times.
    step_s : float
        Median interval between reports, seconds; 0 if unknown.
    regular : bool
        Whether reports come at regular intervals, so that a missing one was lost.
    lead_s : float
        End of a report's interval relative to its stamp, seconds; NaN if no detection had a time.
        No report has a detection later than this, and no following one has an earlier detection.
    """

    lays: FloatArray = np.zeros((0, 3))
    step_s: float = 0.0
    regular: bool = True
    lead_s: float = math.nan

    @property
    def last_s(self) -> float:
        """Stamp of the latest report, seconds; NaN before the first."""
        return float(self.lays[-1, 0]) if len(self.lays) else math.nan

    def after(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> Horizon:
        """Return the horizon after a new report.

        Parameters
        ----------
        stamp_s : float
        time_s : array of shape (M,)
            Times of its detections; empty if the detections have none.
        turn_s : float
            Time of a turn, seconds.
        """
        lay = [stamp_s, math.nan, math.nan]
        if len(time_s):
            time_s = self._plausible_times(stamp_s, time_s, turn_s)
            lay[1:] = time_s.min() - self.last_s, time_s.max() - stamp_s
        kept = self.lays[:, 0] > stamp_s - TURNS * turn_s
        kept[-REPORTS:] = True
        lays = np.vstack([self.lays[kept], lay])
        steps = np.diff(lays[:, 0])
        step_s = float(np.median(steps)) if len(steps) else 0.0
        even = len(steps) < LEAST_STEPS or np.median(np.abs(steps / step_s - 1.0)) < REGULAR
        lead_s = np.fmin.reduce([np.fmax.reduce(lays[:, 2]), *lays[:, 1]])
        return Horizon(lays, step_s, bool(even), self.lead_s if np.isnan(lead_s) else float(lead_s))

    def _plausible_times(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> FloatArray:
        """Return the times that are plausible for a report, without those off by a turn.

        If most are elsewhere than expected, the radar has changed its way of reporting, and all
        are used.
        """
        if math.isnan(self.lead_s) or not self.step_s:
            return time_s
        end_s, begin_s = stamp_s + self.lead_s, self.last_s + self.lead_s
        beyond_s = min(BEYOND * self.step_s, BEYOND_TURNS * turn_s)
        near = (time_s > begin_s - beyond_s) & (time_s < end_s + beyond_s)
        return time_s[near] if 2 * np.count_nonzero(near) > len(time_s) else time_s
