"""Estimates the end of the interval of time that each report of a radar covers.

Radars stamp a report at the end of its sector, in the middle of its revolution, or when it is sent.
The detections' own times show which of these a radar does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, median


class ReportTiming(NamedTuple):
    """Timing of the latest reports of a radar, from which the next one's is predicted."""

    # One row for each report, oldest first, seconds, (K, 3): its stamp; the time of its first
    # detection after the previous report's stamp; and the time of its last detection after its own
    # stamp. NaN if the detections have no times.
    timings: FloatArray = np.zeros((0, 3))
    last_s: float = math.nan  # Stamp of the latest report, seconds; NaN before the first
    interval_s: float = 0.0  # Median interval between reports, seconds; 0 if unknown
    # True if reports come at regular intervals, so that a missing one was lost.
    regular: bool = True
    # End of a report's interval relative to its stamp, seconds; NaN if no detection had a time. No
    # report has a detection later than this, and no following one has an earlier detection.
    lead_s: float = math.nan

    def after(self, stamp_s: float, time_s: FloatArray, period_s: float) -> ReportTiming:
        """Return the timing after a new report.

        `time_s` has the times of its detections, (M,), empty without any; `period_s` is the
        rotation period.
        """
        timing = [stamp_s, math.nan, math.nan]
        if time_s.size:
            time_s = self._plausible_times(stamp_s, time_s, period_s)
            timing[1:] = time_s.min() - self.last_s, time_s.max() - stamp_s
        # Time for which reports are remembered, in revolutions.
        recent = self.timings[:, 0] > stamp_s - 4.0 * period_s
        # Smallest number of reports that are remembered.
        recent[-8:] = True
        timings = np.concatenate([self.timings[recent], [timing]])
        intervals = timings[1:, 0] - timings[:-1, 0]
        interval_s = median(intervals) if intervals.size else 0.0
        # A radar with fewer report intervals counts as regular.
        regular = intervals.size < 4 or (
            # Largest median relative deviation of the report intervals of a regular radar.
            median(np.abs(intervals / interval_s - 1.0)) < 0.15
        )
        lead_s = np.fmin(np.fmax.reduce(timings[:, 2]), np.fmin.reduce(timings[:, 1]))
        lead_s = self.lead_s if np.isnan(lead_s) else float(lead_s)
        return ReportTiming(timings, stamp_s, interval_s, regular, lead_s)

    def _plausible_times(self, stamp_s: float, time_s: FloatArray, period_s: float) -> FloatArray:
        """Return the times that are plausible for a report, without those off by a revolution.

        If most are elsewhere than expected, the radar has changed its way of reporting, and all
        are used.
        """
        if math.isnan(self.lead_s) or not self.interval_s:
            return time_s
        end_s, begin_s = stamp_s + self.lead_s, self.last_s + self.lead_s
        # Detections farther than this beyond the expected end of a report do not move it, in report
        # intervals and in revolutions.
        beyond_s = min(0.75 * self.interval_s, 0.06 * period_s)
        near = (time_s > begin_s - beyond_s) & (time_s < end_s + beyond_s)
        plausible = time_s[near]
        return plausible if 2 * plausible.size > time_s.size else time_s
