# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Up to which time the reports of a radar account for what its antenna passed.

A stamp is somewhere in the time that its report is about, or beside it: at the end of a sector, in
the middle of a turn, or when the report was sent. Where it is, the detections' own times tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .arrays import FloatArray

# For so many turns reports are remembered, and so many reports at least.
TURNS, REPORTS = 4.0, 8
# A radar is regular whose times between reports differ by less than this part, as a rule.
REGULAR, LEAST_STEPS = 0.15, 4
# Detections this far beyond the expected end of a report, in steps and in turns, do not move it.
BEYOND, BEYOND_TURNS = 0.75, 0.06


class Lay(NamedTuple):
    """How a report lay about the stamps, seconds; NaN without detections that have times.

    Parameters
    ----------
    stamp_s : float
    first_s : float
        Time of its first detection, after the stamp of the report before.
    last_s : float
        Time of its last detection, after its own stamp.
    """

    stamp_s: float
    first_s: float = math.nan
    last_s: float = math.nan


class Horizon(NamedTuple):
    """The latest reports of a radar, oldest first."""

    reports: tuple[Lay, ...] = ()

    @property
    def steps_s(self) -> FloatArray:
        """Times between reports, seconds."""
        return np.diff([each.stamp_s for each in self.reports])

    @property
    def step_s(self) -> float:
        """The usual time between reports, seconds; 0 if it is not known."""
        return float(np.median(self.steps_s)) if len(self.reports) > 1 else 0.0

    @property
    def regular(self) -> bool:
        """Whether reports come at even times, so that one that does not come was lost."""
        steps = self.steps_s
        if len(steps) < LEAST_STEPS:
            return True
        return bool(np.median(np.abs(steps / np.median(steps) - 1.0)) < REGULAR)

    @property
    def lead_s(self) -> float:
        """How far after its stamp a report's time ends, seconds; NaN if detections do not tell.

        No report's last detection is later, and no next report's first one is earlier.
        """
        last = [each.last_s for each in self.reports if not math.isnan(each.last_s)]
        first = [each.first_s for each in self.reports if not math.isnan(each.first_s)]
        return min([max(last), *first]) if last else math.nan

    def after(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> Horizon:
        """Return the reports with a new one.

        Parameters
        ----------
        stamp_s : float
        time_s : array of shape (M,)
            Times of its detections; empty if they have none of their own.
        turn_s : float
            Time of a turn, seconds.
        """
        lay = Lay(stamp_s)
        if len(time_s):
            time_s = self._believed(stamp_s, time_s, turn_s)
            before_s = self.reports[-1].stamp_s if self.reports else math.nan
            first_s, last_s = float(time_s.min()), float(time_s.max())
            lay = Lay(stamp_s, first_s - before_s, last_s - stamp_s)
        older, newer = self.reports[:-REPORTS], self.reports[-REPORTS:]
        kept = tuple(each for each in older if each.stamp_s > stamp_s - TURNS * turn_s)
        return Horizon((*kept, *newer, lay))

    def _believed(self, stamp_s: float, time_s: FloatArray, turn_s: float) -> FloatArray:
        """Return the times that can be of a report; one that is a turn off does not tell its end.

        If most are elsewhere than expected, the radar reports in another way than before.
        """
        lead_s, step_s = self.lead_s, self.step_s
        if math.isnan(lead_s) or not step_s:
            return time_s
        end_s, begin_s = stamp_s + lead_s, self.reports[-1].stamp_s + lead_s
        beyond_s = min(BEYOND * step_s, BEYOND_TURNS * turn_s)
        near = (time_s > begin_s - beyond_s) & (time_s < end_s + beyond_s)
        return time_s[near] if 2 * np.count_nonzero(near) > len(time_s) else time_s
