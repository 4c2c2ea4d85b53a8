"""Scores of the tracks of a simulated hour-long recording of a turning radar.

The user's commands choose the plane and the clock of the tracks, so that the truth is converted
before it is compared:

::

    truth in the scenario's plane
      |  noise-free measurement: slant range, azimuth from true north, height
      |  the tracker's conversion of plots with this range, azimuth and, if replied, height
    truth in the tracks' plane

The time shift of the recording is subtracted from the tracks' stamps. The plot Kalman tracker gets
the same plots, converted in the same way, with their own times.

Tracks are scored once a revolution, at their stamp nearest to the end of the radar's revolution; a
revolution without a stamp within half a revolution of it has no tracks. A target is in sight
between two passes of the beam at most `IN_SIGHT_REVOLUTIONS` apart in both of which it could be
detected. It is scored while in sight, unless it is slow as in `turning`, from its `LEAST_LOOKS`-th
pass in sight on, since a track needs that many plots. Tracks of unscored targets are left out;
tracks near no target are false.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.columns import ground_ranges
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import Detections, Estimates, Truth
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.turning_antenna import (
    SimulatedReport,
    TurningRadar,
    plots_with_replies,
)
from phd_jdtc_ros.study.tracker import TAXIING, revolution_ends

from ..peers.plot_kalman import follow
from ..runner import half_width

# A target counts as found if it has an estimate within this distance, metres.
FOUND_M = 500.0
IN_SIGHT_REVOLUTIONS, LEAST_LOOKS = 1.5, 3
# Number of parts of an hour whose figures are compared for intervals.
BLOCKS = 12
# Number of plot times from which the shift of a recording is estimated, and its resolution,
# seconds.
SHIFT_TIMES, SHIFT_STEP_S = 400, 1.0 / 128.0


class Scores(NamedTuple):
    """The scores of a tracker on an hour."""

    instants: int  # Number of scored targets, summed over the revolutions
    found: float  # Share of the instants with an estimate within `FOUND_M`
    found_from_first: float  # The same if targets are scored from their first pass in sight on
    rms: float  # Root mean square error of these estimates, metres; `FOUND_M` if there are none
    false_a_revolution: float  # Mean number of estimates near no target
    switches: int  # Identity switches of targets in sight, see `IdentitySwitches`
    # `renumbered`, `returned`: number of targets with another track number after a gap in sight
    # than before it, and of all targets tracked both before and after a gap.
    renumbered: int
    returned: int
    # Half the widths of 95 % intervals of the figures of `_rates`, from the differences between
    # `BLOCKS` consecutive parts of the hour.
    half_width: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Reader:
    """A tracker's conversion of a radar's plots to its plane."""

    layout: RadarParameters
    radar: RadarModel  # The radar in the tracks' plane

    def ground(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return ranges and azimuths over ground, (M, 2), and whether each is possible, (M,).

        Slant ranges and heights, NaN if unknown, are in metres, azimuths in radians
        counter-clockwise from true east.
        """
        known = height if self.layout.fields.height else None
        own = azimuth - self.radar.yaw if self.layout.site is None else azimuth
        found = ground_ranges.read(distance, own, None, known, self.layout)
        return np.stack([found.distance, found.azimuth], axis=1), found.possible


@dataclass(frozen=True)
class Hour:
    """A seeded run of a scenario with one turning radar that has a site on the earth."""

    scenario: Scenario
    layout: RadarParameters  # Site and message layout of the radar
    seed: int

    @property
    def rotation_s(self) -> float:
        """Mean time of a revolution."""
        return self.scenario.radars[0].rotation_s

    @cached_property
    def ends_s(self) -> FloatArray:
        """The ends of the revolutions that are scored, seconds after scan 0.

        The third revolution is the first, since no target has `LEAST_LOOKS` passes before it.
        """
        return np.array(revolution_ends(self.scenario)[LEAST_LOOKS - 1 :])

    @property
    def turning(self) -> TurningRadar:
        """The radar with the scenario that it sees."""
        return TurningRadar(self.scenario, 0, self.layout)

    @cached_property
    def plots(self) -> tuple[FloatArray, Detections]:
        """The times of all plots, seconds after scan 0, and the measurements."""
        plots, found = plots_with_replies(self.turning, self.seed)
        return self.turning.times_at(plots.revolutions), found

    @cached_property
    def in_sight(self) -> dict[int, FloatArray]:
        """The times at which the beam passes a target, seconds after scan 0, by its number."""
        own = self.turning.looks()
        seen = self.scenario.radars[0].visibility.probability_in_view(own.exact) > 0.0
        numbers = np.unique(own.source[seen]).tolist()
        return {number: own.time_s[seen & (own.source == number)] for number in numbers}

    def passes(self, number: int, time_s: float) -> int:
        """Return the number of passes over a target since it came into sight; 0 out of sight."""
        known = self.in_sight.get(number, np.zeros(0))
        count = int(np.searchsorted(known, time_s, side="right"))
        apart = np.diff(known[: count + 1])
        longest_s = IN_SIGHT_REVOLUTIONS * self.rotation_s
        if count in (0, len(known)) or apart[-1] > longest_s:
            return 0
        # The target came into sight after its last gap.
        came = np.flatnonzero(apart > longest_s)
        return count - (int(came[-1]) + 1 if len(came) else 0)

    def truth(self, time_s: float, reader: Reader) -> tuple[Truth, FloatArray]:
        """Return the targets at a time after scan 0, and their positions in the tracks' plane."""
        truth = truth_after(self.scenario, time_s)
        height = np.zeros(len(truth.track_id)) if truth.height is None else truth.height[:, 0]
        times_s = np.full(len(height), time_s)
        distance, azimuth = self.turning.measure(truth.state, times_s, height).T
        # The height of a target without a transponder is unknown to every tracker.
        equipped = [self.scenario.has_transponder(number) for number in truth.track_id.tolist()]
        known = np.where(equipped, height + self.layout.datum, np.nan)
        ground, _ = reader.ground(distance, azimuth, known)
        return truth, reader.radar.to_world(ground)


def shift_s(own_s: FloatArray, recorded_s: FloatArray) -> float:
    """Return the time shift of a recording against the simulation, seconds.

    The times are of plots in the simulation and in the recording; some may be missing in either.
    """
    some = recorded_s[np.linspace(0, len(recorded_s) - 1, SHIFT_TIMES).astype(np.int64)]
    differences = (some[:, None] - own_s).ravel()
    least = float(differences.min())
    step = np.round((differences - least) / SHIFT_STEP_S).astype(np.int64)
    # Differences of corresponding times agree up to the resolution of the radar's clock.
    counts = np.convolve(np.bincount(step), np.ones(3), mode="same")
    return float(np.median(differences[np.abs(step - np.argmax(counts)) <= 1]))


def tracks(
    hour: Hour, found: Sequence[Estimates], later_s: float
) -> tuple[FloatArray, list[PointSet]]:
    """Return the scored times, s after scan 0, and the tracks at each, a set per revolution.

    The estimates are of one source; their stamps are `later_s` later than the simulation's times
    since the epoch, seconds.
    """
    ordered = sorted(found, key=lambda estimates: estimates.stamp_ns)
    zero_ns = hour.scenario.start_ns + round(later_s * 1e9)
    stamp_s = np.array([(each.stamp_ns - zero_ns) * 1e-9 for each in ordered])
    times_s, points = [], []
    none = np.zeros(0, dtype=np.int64)
    nothing = PointSet(np.zeros((0, 2)), none, none)
    for end_s in hour.ends_s.tolist():
        row = int(np.argmin(np.abs(stamp_s - end_s))) if len(stamp_s) else 0
        there = len(stamp_s) > 0 and abs(stamp_s[row] - end_s) <= 0.5 * hour.rotation_s
        times_s.append(float(stamp_s[row]) if there else end_s)
        points.append(PointSet.of(ordered[row]) if there else nothing)
    return np.array(times_s), points


def plot_kalman(hour: Hour, reader: Reader, times_s: FloatArray) -> list[PointSet]:
    """Return the plot Kalman tracker's tracks from the same plots, at times after scan 0.

    It knows the radar's true noise.
    """
    time_s, found = hour.plots
    height = np.full(len(found), np.nan) if found.height is None else found.height
    distance, azimuth = found.measurement.T
    ground, possible = reader.ground(distance, azimuth, height + hour.layout.datum)
    detections = Detections(ground[possible], None, time_s=time_s[possible])
    true = hour.scenario.radars[0]
    own = replace(true, position=reader.radar.position, yaw=reader.radar.yaw)
    stamps_ns = [round(time_s * 1e9) for time_s in times_s.tolist()]
    return follow([SimulatedReport(0, 0, detections, np.zeros(0, np.int64))], [own], stamps_ns)


def scores(hour: Hour, reader: Reader, times_s: FloatArray, found: Sequence[PointSet]) -> Scores:
    """Return the scores of tracks, one set per time.

    The times are in seconds after scan 0, ascending; the reader converts to the tracks' plane.
    """
    sums = _Sums()
    for time_s, points in zip(times_s.tolist(), found, strict=True):
        truth, position = hour.truth(time_s, reader)
        passes = np.array([hour.passes(n, time_s) for n in truth.track_id.tolist()], dtype=np.int64)
        passes[np.hypot(*truth.velocity.T) < TAXIING.below] = 0
        sums.add(truth.track_id, position, passes, points)
    return sums.scores()


def _rates(revolutions: FloatArray) -> dict[str, float]:
    """Return the figures that revolutions have by themselves, given the rows of `_Sums`."""
    square, paired, instants, early_paired, early, false = revolutions.sum(axis=0).tolist()
    return {
        "found": paired / max(instants, 1.0),
        "found_from_first": early_paired / max(early, 1.0),
        "rms": math.sqrt(square / paired) if paired else FOUND_M,
        "false_a_revolution": false / max(len(revolutions), 1),
    }


class _Sums:
    """Accumulates the figures of `scores`, revolution by revolution."""

    def __init__(self) -> None:
        self._switches = IdentitySwitches(FOUND_M)
        # Each revolution has its squared errors, targets found and all, the same from the first
        # pass on without the errors, and false estimates.
        self._revolutions: list[tuple[float, ...]] = []
        self._switched = 0
        # The last track number of each target in sight, and of each target since out of sight.
        self._number: dict[int, int] = {}
        self._gone: dict[int, int] = {}
        self._renumbered, self._returned = 0, 0

    def add(self, label: IntArray, position: FloatArray, passes: IntArray, own: PointSet) -> None:
        """Add a revolution: T targets, the number of passes over each, and the tracks."""
        settled = passes >= LEAST_LOOKS
        rest = _without(own, position, ~settled)
        row, column = assign(position[settled], rest.position, FOUND_M)
        distance = np.hypot(*(position[settled][row] - rest.position[column]).T)
        seen = passes > 0
        early = len(assign(position[seen], own.position, FOUND_M)[0])
        found = (distance**2).sum(), len(row), np.count_nonzero(settled)
        counts = early, np.count_nonzero(seen), len(rest) - len(row)
        self._revolutions.append(tuple(map(float, (*found, *counts))))
        true = LabelledPoints(label[settled], position[settled])
        numbers = np.zeros(len(rest), np.int64) if rest.track_id is None else rest.track_id
        self._switched += self._switches.add(
            true, LabelledPoints(numbers, rest.position), rest.coasting
        )
        found_numbers = zip(true.label[row].tolist(), numbers[column].tolist(), strict=True)
        self._follow(label, passes, dict(found_numbers))

    def _follow(self, label: IntArray, passes: IntArray, number: dict[int, int]) -> None:
        """Compare targets' track numbers before and after a gap in sight."""
        for target in label[passes == 0].tolist():
            if target in self._number:
                self._gone[target] = self._number.pop(target)
        for target, own in number.items():
            before = self._gone.pop(target, None)
            if before is not None:
                self._returned += 1
                self._renumbered += own != before
        self._number.update(number)

    def scores(self) -> Scores:
        """Return the scores of all revolutions."""
        revolutions = np.array(self._revolutions).reshape(-1, 6)
        blocks = [_rates(block) for block in np.array_split(revolutions, BLOCKS) if len(block)]
        return Scores(
            instants=int(revolutions[:, 2].sum()),
            **_rates(revolutions),
            switches=self._switched,
            renumbered=self._renumbered,
            returned=self._returned,
            half_width=half_width(blocks) if len(blocks) > 1 else {},
        )


def _without(own: PointSet, position: FloatArray, unscored: BoolArray) -> PointSet:
    """Return the tracks of scored targets and the false tracks."""
    target, track = assign(position, own.position, TAXIING.near)
    return own.only(np.delete(np.arange(len(own)), track[unscored[target]]))
