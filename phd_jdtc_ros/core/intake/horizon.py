"""Up to which time the reports of a radar account for what its antenna passed.

A stamp is somewhere in the time that its report is about, or beside it: at the end of a sector, in
the middle of a turn, or when the report was sent. Where it is, the detections' own times tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray

# For so many turns reports are remembered, and so many reports at least.
TURNS, REPORTS = 4.0, 8
# A radar is regular whose times between reports differ by less than this part, as a rule.
REGULAR, LEAST_STEPS = 0.15, 4
# Detections this far beyond the expected end of a report, in steps and in turns, do not move it.
BEYOND, BEYOND_TURNS = 0.75, 0.06


class Horizon(NamedTuple):
    """What the latest reports of a radar say of the next one.

    Parameters
    ----------
    lays : array of shape (K, 3)
        Of each report, oldest first, seconds: its stamp, its first detection after the stamp of the
        one before, and its last detection after its own; NaN without detections' times.
    step_s : float
        The usual time between reports, seconds; 0 if it is not known.
    regular : bool
        Whether reports come at even times, so that one that does not come was lost.
    lead_s : float
        How far after its stamp a report's time ends, seconds; NaN if no detection had a time. No
        report's last detection is later, and no next report's first one is earlier.
    """

    lays: FloatArray = np.zeros((0, 3))
    step_s: float = 0.0
    regular: bool = True
    lead_s: float = math.nan

    @property
    def last_s(self) -> float:
        """Stamp of the latest report, seconds; NaN without any."""
        return float(self.lays[-1, 0]) if len(self.lays) else math.nan

    def after(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> Horizon:
        """Return the same with a new report.

        Parameters
        ----------
        stamp_s : float
        time_s : array of shape (M,)
            Times of its detections; empty if they have none of their own.
        turn_s : float
            Time of a turn, seconds.
        """
        lay = [stamp_s, math.nan, math.nan]
        if len(time_s):
            time_s = self._believed(stamp_s, time_s, turn_s)
            lay[1:] = time_s.min() - self.last_s, time_s.max() - stamp_s
        kept = self.lays[:, 0] > stamp_s - TURNS * turn_s
        kept[-REPORTS:] = True
        lays = np.vstack([self.lays[kept], lay])
        steps = np.diff(lays[:, 0])
        step_s = float(np.median(steps)) if len(steps) else 0.0
        even = len(steps) < LEAST_STEPS or np.median(np.abs(steps / step_s - 1.0)) < REGULAR
        lead_s = np.fmin.reduce([np.fmax.reduce(lays[:, 2]), *lays[:, 1]])
        return Horizon(lays, step_s, bool(even), self.lead_s if np.isnan(lead_s) else float(lead_s))

    def _believed(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> FloatArray:
        """Return the times that can be of a report; one that is a turn off does not tell its end.

        If most are elsewhere than expected, the radar reports in another way than before.
        """
        if math.isnan(self.lead_s) or not self.step_s:
            return time_s
        end_s, begin_s = stamp_s + self.lead_s, self.last_s + self.lead_s
        beyond_s = min(BEYOND * self.step_s, BEYOND_TURNS * turn_s)
        near = (time_s > begin_s - beyond_s) & (time_s < end_s + beyond_s)
        return time_s[near] if 2 * np.count_nonzero(near) > len(time_s) else time_s
