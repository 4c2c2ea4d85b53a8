"""Scores of what a user makes of a simulated hour of a radar that turns: tracks of its recording.

Whoever tracks the recording chooses the plane and the clock of the tracks. So that only the tracks
are judged:

::

    truth in the scenario's plane
      |  what the radar measures of it without noise: slant range, azimuth from true north, height
      |  as the tracker reads plots with that range, azimuth and, of what answers, height
    truth in the tracks' plane

and the times of the tracks are those of the radar: what the recording was shifted by is taken off.
The plot Kalman tracker gets the same plots, read in the same way, with their own times.

Tracks are scored once a turn, at their own stamp nearest to the end of the radar's turn; a turn
without tracks within half of it has none. A target is scored if it is not slow, as in `turning`,
while it is in sight, and from its `LEAST_LOOKS`-th pass since it came into sight: a track needs
that many plots. It is in sight between two passes of the beam at most `IN_SIGHT_TURNS` apart, in
both of which it could be detected. Tracks of targets that are not scored are left out; what is near
nothing is false.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.slant_range import Ground
from phd_jdtc_ros.core.types import Detections, Estimates, Truth
from phd_jdtc_ros.evaluation.accumulators.identity import IdentitySwitches
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.simulation.looks import looks, slant
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.turning_antenna import Report, answered_plots, plot_times
from phd_jdtc_ros.study.peers.plot_kalman import follow
from phd_jdtc_ros.study.runs import TAXIING
from phd_jdtc_ros.study.turning import turn_ends

# An estimate within this distance of its target has found it, metres.
FOUND_M = 500.0
IN_SIGHT_TURNS, LEAST_LOOKS = 1.5, 3
# So many times of a recording tell what they are later by than those of the simulation; seconds.
SHIFT_TIMES, SHIFT_STEP_S = 400, 1.0 / 128.0


class Scores(NamedTuple):
    """What a tracker made of an hour.

    Parameters
    ----------
    instants : int
        Targets that were scored, once a turn each.
    found : float
        Share of them with an estimate within `FOUND_M`.
    found_from_first : float
        The same if targets are scored from the first pass since they came into sight.
    rms : float
        Distance of these estimates, root mean square, metres; `FOUND_M` if there are none.
    false_a_turn : float
        Estimates near no target.
    switches : int
        See `IdentitySwitches`; of targets in sight.
    renumbered, returned : int
        Targets that had another number after a gap than before it, and all that had one before it
        and after it.
    """

    instants: int
    found: float
    found_from_first: float
    rms: float
    false_a_turn: float
    switches: int
    renumbered: int
    returned: int


@dataclass(frozen=True)
class Reader:
    """How a tracker reads a radar's plots.

    Parameters
    ----------
    layout : RadarInput
    radar : RadarModel
        Where it is in the tracks' plane.
    read : callable of (distance, azimuth, elevation, height, layout)
        `msg_adapters.ground_ranges.read`.
    """

    layout: RadarInput
    radar: RadarModel
    read: Callable[[FloatArray, FloatArray, None, FloatArray | None, RadarInput], Ground]

    def ground(
        self, distance: FloatArray, azimuth: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return ranges and azimuths over ground, (M, 2), and which of them are possible, (M,).

        Parameters
        ----------
        distance, azimuth, height : arrays of shape (M,)
            Slant ranges, metres; radians counter-clockwise from true east; metres, NaN if unknown.
        """
        known = height if self.layout.height_field else None
        own = azimuth - self.radar.yaw if self.layout.site is None else azimuth
        found = self.read(distance, own, None, known, self.layout)
        return np.stack([found.distance, found.azimuth], axis=1), found.possible


@dataclass(frozen=True)
class Hour:
    """A seeded run of a scenario with one radar, which turns and has a site.

    Parameters
    ----------
    scenario : Scenario
    layout : RadarInput
        Where it stands.
    seed : int
    """

    scenario: Scenario
    layout: RadarInput
    seed: int

    @property
    def rotation_s(self) -> float:
        """Mean time of a turn."""
        return self.scenario.radars[0].rotation_s

    @cached_property
    def ends_s(self) -> FloatArray:
        """When each turn ends, seconds after scan 0; the first in which tracks may be is the third.

        Before it nothing can have had `LEAST_LOOKS`.
        """
        return np.array(turn_ends(self.scenario)[LEAST_LOOKS - 1 :])

    @cached_property
    def plots(self) -> tuple[FloatArray, Detections]:
        """The times of all plots, seconds after scan 0, and what was measured."""
        plots, found = answered_plots(self.scenario, 0, self.layout, self.seed)
        return plot_times(self.scenario, 0, plots), found

    @cached_property
    def in_sight(self) -> dict[int, FloatArray]:
        """When the beam passes each target in sight, seconds after scan 0, by its number."""
        own = looks(self.scenario, 0, self.layout)
        seen = self.scenario.radars[0].visibility.sees(own.exact) > 0.0
        numbers = np.unique(own.source[seen]).tolist()
        return {number: own.time_s[seen & (own.source == number)] for number in numbers}

    def passes(self, number: int, time_s: float) -> int:
        """Return how often the beam has passed a target since it came into sight; 0 out of it."""
        known = self.in_sight.get(number, np.zeros(0))
        count = int(np.searchsorted(known, time_s, side="right"))
        apart = np.diff(known[: count + 1])
        longest_s = IN_SIGHT_TURNS * self.rotation_s
        if count in (0, len(known)) or apart[-1] > longest_s:
            return 0
        # It came into sight after the last time that it was out of it.
        came = np.flatnonzero(apart > longest_s)
        return count - (int(came[-1]) + 1 if len(came) else 0)

    def truth(self, time_s: float, reader: Reader) -> tuple[Truth, FloatArray]:
        """Return the targets at a time after scan 0, and where they are in a tracks' plane."""
        truth = truth_after(self.scenario, time_s)
        height = np.zeros(len(truth.track_id)) if truth.height is None else truth.height[:, 0]
        plane = self.scenario.measured(0, truth.state, np.full(len(height), time_s))
        distance, azimuth = slant(self.layout, plane, height).T
        # Of targets that answer nothing no tracker knows the height.
        told = [self.scenario.answers(number) for number in truth.track_id.tolist()]
        known = np.where(told, height + self.layout.datum, np.nan)
        ground, _ = reader.ground(distance, azimuth, known)
        return truth, reader.radar.to_world(ground)


def shift_s(own_s: FloatArray, recorded_s: FloatArray) -> float:
    """Return what the times of a recording are later by than those of the simulation, seconds.

    Parameters
    ----------
    own_s, recorded_s : arrays of shape (M,) and (K,)
        Times of plots; some may be missing.
    """
    some = recorded_s[np.linspace(0, len(recorded_s) - 1, SHIFT_TIMES).astype(np.int64)]
    differences = (some[:, None] - own_s).ravel()
    least = float(differences.min())
    step = np.round((differences - least) / SHIFT_STEP_S).astype(np.int64)
    # Of all pairs those that belong together agree, but for the steps of the radar's clock.
    counts = np.convolve(np.bincount(step), np.ones(3), mode="same")
    return float(np.median(differences[np.abs(step - np.argmax(counts)) <= 1]))


def tracks(
    hour: Hour, found: Sequence[Estimates], later_s: float
) -> tuple[FloatArray, list[PointSet]]:
    """Return when tracks are scored, seconds after scan 0, and the tracks then, one per turn.

    Parameters
    ----------
    hour : Hour
    found : sequence of Estimates
        Of one source.
    later_s : float
        What their stamps are later by than the simulation's times since the epoch, seconds.
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
    """Return what the plot Kalman tracker makes of the same plots, at times after scan 0.

    It knows the radar's true noise.
    """
    time_s, found = hour.plots
    height = np.full(len(found), np.nan) if found.height is None else found.height
    distance, azimuth = found.measurement.T
    ground, possible = reader.ground(distance, azimuth, height + hour.layout.datum)
    detections = Detections(ground[possible], None, time_s=time_s[possible])
    true = hour.scenario.radars[0]
    own = replace(true, position=reader.radar.position, yaw=reader.radar.yaw)
    return follow([Report(0, 0, detections, np.zeros(0, np.int64))], [own], _ns(times_s))


def _ns(times_s: FloatArray) -> list[int]:
    return [round(time_s * 1e9) for time_s in times_s.tolist()]


def scores(hour: Hour, reader: Reader, times_s: FloatArray, found: Sequence[PointSet]) -> Scores:
    """Return the scores of tracks, one set per time.

    Parameters
    ----------
    hour : Hour
    reader : Reader
        Of the tracks' plane.
    times_s : array of shape (K,)
        After scan 0, ascending.
    found : sequence of K PointSet
    """
    sums = _Sums()
    for time_s, points in zip(times_s.tolist(), found, strict=True):
        truth, position = hour.truth(time_s, reader)
        passes = np.array([hour.passes(n, time_s) for n in truth.track_id.tolist()], dtype=np.int64)
        passes[np.hypot(*truth.velocity.T) < TAXIING.below] = 0
        sums.add(truth.track_id, position, passes, points)
    return sums.scores(len(times_s))


class _Sums:
    """Adds up what `scores` returns, turn by turn."""

    def __init__(self) -> None:
        self._switches = IdentitySwitches(FOUND_M)
        self._square, self._paired, self._instants = 0.0, 0, 0
        self._early, self._early_paired, self._false, self._switched = 0, 0, 0, 0
        # The last number of each target, and of those that are out of sight since.
        self._number: dict[int, int] = {}
        self._gone: dict[int, int] = {}
        self._renumbered, self._returned = 0, 0

    def add(self, label: IntArray, position: FloatArray, passes: IntArray, own: PointSet) -> None:
        """Add a turn: T targets, how often the beam has passed each, and the tracks."""
        settled = passes >= LEAST_LOOKS
        rest = _without(own, position, ~settled)
        row, column = assign(position[settled], rest.position, FOUND_M)
        distance = np.hypot(*(position[settled][row] - rest.position[column]).T)
        self._square += float((distance**2).sum())
        self._paired += len(row)
        self._instants += int(np.count_nonzero(settled))
        self._false += len(rest) - len(row)
        seen = passes > 0
        self._early += int(np.count_nonzero(seen))
        self._early_paired += len(assign(position[seen], own.position, FOUND_M)[0])
        true = LabelledPoints(label[settled], position[settled])
        numbers = np.zeros(len(rest), np.int64) if rest.track_id is None else rest.track_id
        self._switched += self._switches.add(
            true, LabelledPoints(numbers, rest.position), rest.coasting
        )
        self._follow(
            label,
            passes,
            dict(zip(true.label[row].tolist(), numbers[column].tolist(), strict=True)),
        )

    def _follow(self, label: IntArray, passes: IntArray, number: dict[int, int]) -> None:
        """Compare the numbers of targets before and after they were out of sight."""
        for target in label[passes == 0].tolist():
            if target in self._number:
                self._gone[target] = self._number.pop(target)
        for target, own in number.items():
            before = self._gone.pop(target, None)
            if before is not None:
                self._returned += 1
                self._renumbered += own != before
        self._number.update(number)

    def scores(self, turns: int) -> Scores:
        """Return what was added up."""
        mean = self._square / self._paired if self._paired else FOUND_M**2
        return Scores(
            self._instants,
            self._paired / max(self._instants, 1),
            self._early_paired / max(self._early, 1),
            float(np.sqrt(mean)),
            self._false / max(turns, 1),
            self._switched,
            self._renumbered,
            self._returned,
        )


def _without(own: PointSet, position: FloatArray, unscored: BoolArray) -> PointSet:
    """Return the tracks but those of targets that are not scored."""
    target, track = assign(position, own.position, TAXIING.near)
    return own.only(np.delete(np.arange(len(own)), track[unscored[target]]))
