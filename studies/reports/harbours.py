"""How well ships' own reports are joined with the tracks of a radar, in simulated harbours.

The layer of self-reports is scored against the truth: errors of ships with AIS, calls of ships
that are dark and of one that lies, owners of sources, track numbers, and the calibration of the
probabilities. The same radar without a receiver is the reference; the receiver without the radar
and another tracker with the radar's plots are beside them.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.pipeline import Event, Stepped
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.types import Estimates, SelfReports
from phd_jdtc_ros.core.types.reports import ALARM, LEFT, MMSI, Reported
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports
from phd_jdtc_ros.tally import Tally

from .. import runner
from ..calibration.diagram import draw
from ..calibration.scores import Bins, Reliability, binned, pooled
from ..peers.plot_kalman import SETTINGS, follow
from ..runner import Figures, Study

START_NS = 1_700_000_000 * 10**9
TURN_S = 2.4
RADAR = {
    "sensors": ["radar"],
    "interval_s": TURN_S,
    "estimates_period_s": TURN_S,
    "lag": 0,
    "max_gap_scans": 20.0,
    "classes": ["ship", "boat"],
    "motions": ["cv"],
    "cv.model": "constant_velocity",
    "cv.noise_density": 0.02,
    **{f"{name}.motions": ["cv"] for name in ("ship", "boat")},
    **{f"{name}.mode_transition": [1.0] for name in ("ship", "boat")},
    **{f"{name}.survival_probability": 0.9999 for name in ("ship", "boat")},
    "ship.snr_band_db": [18.0, 22.0],
    "boat.snr_band_db": [10.0, 14.0],
    "detection_births.rates": [0.2, 0.05],
    "detection_births.std": [5.0],
    "radar.position": [0.0, -7000.0],
    "radar.rotation_s": TURN_S,
    "radar.fields.time": "time",
    # 35 m across at 7 km.
    "radar.range_std": 12.0,
    "radar.azimuth_std_deg": 0.29,
    "radar.max_range": 18000.0,
    "radar.detection_probability": 0.9,
    "radar.false_alarm_probability": 0.001,
    "radar.clutter_rate": 8.0,
    "radar.clutter_max_range": 18000.0,
    "radar.learn": [],
}
RECEIVER = {
    "sensors": ["radar", "ais"],
    "ais.kind": "reports",
    "ais.obliged": ["ship"],
}
CLASS_A, CLASS_B, CLONE, LIAR, DARK, BOAT = "class A", "class B", "clone", "liar", "dark", "boat"
KINDS = (*[CLASS_A] * 4, *[CLASS_B] * 2, *[CLONE] * 2, LIAR, *[DARK] * 3, *[BOAT] * 2)
HONEST = CLASS_A, CLASS_B, CLONE
# The probabilities that are compared with the truth.
CALIBRATED = ("dark", "silent", "owned", "doubtful")
TRUE_KINDS = (*HONEST, LIAR, BOAT)  # Those that are not dark
FIRST_MMSI = 211_000_001
DURATION_S, SETTLING_S, LIES_S = 900.0, 60.0, 180.0
LIKE_TRUTH_S = 30.0  # A lie is within the errors for so long, seconds
NEAR = 150.0  # Largest distance between a track and its ship, metres
# Of ships this near to another one the assignment does not tell whose track one is, metres.
APART = 60.0
# A track is of the ship that it has most often been assigned to within this time of it, before and
# after, seconds: the first plots of two ships may be nearer to the other one of them.
FOLLOWED_S = 30.0
# Edges of the bins of these probabilities, and the largest difference that is a goal.
BOUNDS = (0.0, 0.1, 0.3, 0.7, 0.9, 0.99, 1.0)
TOLERANCE = 0.1
# The plot Kalman tracker with the noise of these ships, chosen by its RMS errors on seeds 50 to 52.
SHIPS = replace(SETTINGS, noise_density=0.01, speed_std=8.0)
RADAR_ALONE, REPORTS_ALONE, BOTH, PEER = "radar alone", "AIS alone", "both", "plot Kalman"
TRACKERS = RADAR_ALONE, PEER, REPORTS_ALONE, BOTH
# Lies by the velocity that goes with them, in turn by seed.
LIES = ("velocity that fits", "true velocity")
# Its calls are counted from the begin of the lie, and from the receipt of the first false report.
LIAR_CALLS = {"liar": "liar called", "liar_heard": "liar called, after a false report"}


class Transmitters(NamedTuple):
    """What is true of AIS in the scene."""

    antenna: tuple[float, float] = (60.0, 8.0)  # Largest offset ahead and to the left, metres
    # Of positions, metres, and of velocities along each axis, metres per second.
    position_std: float = 8.0
    velocity_std: float = 0.2
    lost: float = 0.15
    hidden_s: float = 40.0  # A stretch in which nothing of a ship is received
    latency_s: tuple[float, float] = (0.1, 3.0)
    drift: float = 5.0  # Of the liar, metres per second
    class_b_s: float = 30.0  # Interval of class B, seconds; 0 if its ships are of class A

    def interval_s(self, kind: str, speed: float) -> float:
        """Return the interval of reports of a ship under way (ITU-R M.1371-5, annex 1, table 1)."""
        if kind == CLASS_B and self.class_b_s:
            return self.class_b_s
        return 10.0 if speed <= 14.0 * 1852.0 / 3600.0 else 6.0


AIS = Transmitters()
# All ships with AIS are of class A, and nothing is lost but single reports.
STEADY = AIS._replace(hidden_s=0.0, class_b_s=0.0)


def scene(config: TrackerConfig, duration_s: float, rng: np.random.Generator) -> Scenario:
    """Return the ships and boats, of `KINDS`, that the radar sees."""
    return Scenario(
        start_ns=START_NS,
        interval_s=TURN_S,
        scans=int(duration_s / TURN_S) + 1,
        targets=tuple(_ship(kind, duration_s, rng) for kind in KINDS),
        radars=polar_radars(config.model.radars),
    )


def _ship(kind: str, duration_s: float, rng: np.random.Generator) -> Flight:
    place = rng.uniform(-3500.0, 3500.0, 2)
    # It heads within 60 degrees of the middle, so that it stays in the harbour.
    course = math.atan2(-place[1], -place[0]) + rng.uniform(-1.0, 1.0)
    speed, legs, left_s = rng.uniform(2.5, 8.0), [], duration_s + TURN_S
    while left_s > 0.0:
        turn_deg, rate = rng.uniform(15.0, 60.0), math.radians(0.4) * rng.choice([-1.0, 1.0])
        legs += [Leg(rng.exponential(200.0) + 1.0), Leg(math.radians(turn_deg) / abs(rate), rate)]
        left_s -= legs[-1].duration_s + legs[-2].duration_s
    return Flight(
        int(kind == BOAT),
        snr_from_db(12.0 if kind == BOAT else 20.0),
        0.0,
        (float(place[0]), float(place[1])),
        (speed * math.cos(course), speed * math.sin(course)),
        tuple(legs),
    )


def addresses() -> list[int]:
    """Return the MMSI of each of `KINDS`; clones have one."""
    clone = KINDS.index(CLONE)
    return [FIRST_MMSI + (clone if kind == CLONE else i) for i, kind in enumerate(KINDS)]


def received(
    seen: Scenario, lie: str, rng: np.random.Generator, own: Transmitters = AIS
) -> list[tuple[float, SelfReports]]:
    """Return the reports that are received, each with the time of its receipt, ascending."""
    found = []
    for kind, address, ship in zip(KINDS, addresses(), seen.flights, strict=True):
        antenna = rng.uniform(-1.0, 1.0, 2) * own.antenna
        hidden_s = rng.uniform(0.0, seen.duration_s - own.hidden_s)
        direction, every_s = (
            rng.uniform(-np.pi, np.pi),
            own.interval_s(kind, np.hypot(*ship.velocity)),
        )
        drift = own.drift * np.array([np.cos(direction), np.sin(direction)])
        for time_s in np.arange(rng.uniform(0.0, every_s), seen.duration_s, every_s):
            noise, latency_s = rng.standard_normal(4), rng.uniform(*own.latency_s)
            lost = rng.random() < own.lost or 0.0 <= time_s - hidden_s < own.hidden_s
            if kind in (DARK, BOAT) or lost:
                continue
            state = ship.states(np.array([time_s]))[0]
            course = ship.courses(np.array([time_s]))[0]
            ahead = np.array([np.cos(course), np.sin(course)])
            place = (
                state[[0, 2]] + antenna[0] * ahead + antenna[1] * np.array([-ahead[1], ahead[0]])
            )
            velocity = state[[1, 3]] + own.velocity_std * noise[2:]
            if kind == LIAR and time_s > LIES_S:
                place += drift * (time_s - LIES_S)
                velocity += drift if lie == LIES[0] else 0.0
            report = SelfReports.of(
                # AIS sends whole seconds.
                np.array([START_NS + int(time_s) * 10**9]),
                (place + own.position_std * noise[:2])[None],
                covariance=own.position_std**2 * np.eye(2)[None],
                velocity=velocity[None],
                address=np.array([address]),
                space=np.array([MMSI]),
                # Class B is told from class A by the type of its messages.
                interval_s=np.array([own.class_b_s if kind == CLASS_B and own.class_b_s else 2.0]),
            )
            found.append((time_s + latency_s, report))
    return sorted(found, key=lambda each: each[0])


def _tracked(
    config: TrackerConfig, plots: Sequence[SimulatedReport], told: list[tuple[float, SelfReports]]
) -> Iterator[Estimates]:
    """Yield the filtered estimates of each revolution."""
    for event in _events(Feed(config, Tally(config)), plots, told):
        if isinstance(event, Stepped):
            yield from event.step.filtered


def _events(
    feed: Feed, plots: Sequence[SimulatedReport], told: list[tuple[float, SelfReports]]
) -> Iterator[Event]:
    waiting = [*told]
    for until_s, plot in (*(((p.stamp_ns - START_NS) * 1e-9, p) for p in plots), (math.inf, None)):
        while waiting and waiting[0][0] <= until_s:
            yield from feed.self_reports(0, partial(Told, waiting.pop(0)[1], Counter()))
        if plot is not None:
            report = Report(plot.stamp_ns, plot.detections, Counter())
            yield from feed.report(plot.radar, report) or ()
    yield from feed.flush()


def _errors(seen: Scenario, found: Iterable[tuple[int, FloatArray]]) -> dict[str, float]:
    """Return how many ships with AIS were found, and their RMS error, metres.

    Those of which an estimate is within `NEAR` are found; the estimates are stamps, and positions
    of shape (T, 2).
    """
    ships = np.array([kind in HONEST for kind in KINDS])
    count, squares = 0, []
    for stamp_ns, place in found:
        now_s = np.array([(stamp_ns - START_NS) * 1e-9])
        if now_s[0] <= SETTLING_S or now_s[0] > seen.duration_s:
            continue
        truth = np.array([ship.states(now_s)[0, [0, 2]] for ship in seen.flights])
        distance = np.hypot(*(truth[:, None] - place).transpose(2, 0, 1))
        row, column = linear_sum_assignment(np.minimum(distance, NEAR))
        near = (distance[row, column] < NEAR) & ships[row]
        count += int(ships.sum())
        squares += (distance[row, column][near] ** 2).tolist()
    return {"found": len(squares) / max(count, 1), "rms": float(np.sqrt(np.mean(squares)))}


class Scores:
    """What is counted in one run."""

    def __init__(self, seen: Scenario, lie: str, told: Sequence[tuple[float, SelfReports]]) -> None:
        self._seen, self._lie, self._addresses = seen, lie, addresses()
        # Before a false report is received nobody can call its liar.
        self._lied_s = min(
            (
                received_s
                for received_s, report in told
                if report.address[0] == self._addresses[KINDS.index(LIAR)]
                and (report.time_ns[0] - START_NS) * 1e-9 > LIES_S
            ),
            default=math.inf,
        )
        # Numbers of ships' tracks, of the radar alone and with reports.
        self._numbers: dict[int, tuple[int, int]] = {}
        self._since: dict[int, float] = {}
        # Tracks of ships: time, number of the radar alone, ship, and the owner that is named, 0 if
        # none, with its probability.
        self._followed: list[tuple[float, int, int, int, float]] = []
        # What was called at the last revolution: ships dark, and addresses doubtful.
        self._dark: set[int] = set()
        self._doubted: set[int] = set()
        self.figures: Figures = {
            **{name: [] for name in ("radar", "joint", "nees")},
            **{f"{name}_{each}": [] for name in CALIBRATED for each in ("said", "true")},
            **dict.fromkeys(("false_doubts", "owned", "wrong"), 0),
            **{"source_hours": 0.0, "changes": [0, 0]},
            # By kind, of those that are not dark.
            **{name: dict.fromkeys(TRUE_KINDS, 0.0) for name in ("false_dark", "ship_hours")},
            **{"calls": [None] * KINDS.count(DARK)},
            **{name: {lie: [None]} for name in LIAR_CALLS},
        }

    def add(self, alone: Estimates, joint: Estimates) -> None:
        """Score the estimates of one time, of the radar alone and with reports.

        The rows of radar tracks are those of the radar alone, in the same order.
        """
        now_s = (joint.stamp_ns - START_NS) * 1e-9
        told = joint.reports or Reported.unknown(len(joint))
        rows = np.flatnonzero(told.alone == 0)
        if len(rows) != len(alone):
            raise runner.StudyError(f"{len(rows)} tracks of the radar, expected {len(alone)}")
        truth = np.array([ship.states(np.array([now_s]))[0, [0, 2]] for ship in self._seen.flights])
        confirmed = np.flatnonzero(alone.track_state > 0)
        distance = np.hypot(*(truth[:, None] - alone.position[None, confirmed]).transpose(2, 0, 1))
        pairs = zip(*linear_sum_assignment(np.minimum(distance, NEAR)), strict=True)
        called = set()
        gap = np.hypot(*(truth[:, None] - truth).transpose(2, 0, 1)) + NEAR * np.eye(len(truth))
        for ship, column in pairs:
            if distance[ship, column] < NEAR:
                row = int(rows[confirmed[column]])
                error = joint.position[row] - truth[ship]
                numbers = int(alone.track_id[confirmed[column]]), int(joint.track_id[row])
                before = self._numbers.get(int(ship), numbers)
                self._numbers[int(ship)] = numbers
                for place, (old, new) in enumerate(zip(before, numbers, strict=True)):
                    self.figures["changes"][place] += old != new
                is_apart = gap[ship].min() > APART
                is_owned = is_apart and told.owned[row] > 0.5 and told.reason[row] != LEFT
                owner = (int(told.address[row]), float(told.owned[row])) if is_owned else (0, 0.0)
                self._followed.append((now_s, numbers[0], int(ship), *owner))
                if is_apart:
                    self._add_track(int(ship), now_s, told, row)
                    if told.dark[row] > ALARM:
                        called.add(int(ship))
                if KINDS[ship] in HONEST and now_s > SETTLING_S:
                    self.figures["radar"].append(float(distance[ship, column]))
                    self.figures["joint"].append(float(np.hypot(*error)))
                    weighted = np.linalg.solve(joint.position_covariance[row], error)
                    self.figures["nees"].append(float(error @ weighted) / 2.0)
        self._call_dark(called, now_s)
        self._call_doubtful(told, now_s)

    def add_owners(self) -> None:
        """Count P(owned) of the named owners, and the wrong ones of those that are certain."""
        now_s, number, ship, owner, said = map(np.array, zip(*self._followed, strict=True))
        for each in np.unique(number):
            own = number == each
            near = np.abs(now_s[own, None] - now_s[own]) <= FOLLOWED_S
            follows = (near @ np.eye(len(KINDS))[ship[own]]).argmax(axis=1)
            named = owner[own] > 0
            right = (owner[own] == np.array(self._addresses)[follows])[named]
            certain = said[own][named] > ALARM
            self.figures["owned_said"] += said[own][named].tolist()
            self.figures["owned_true"] += right.tolist()
            self.figures["owned"] += int(certain.sum())
            self.figures["wrong"] += int((certain & ~right).sum())

    def _add_track(self, ship: int, now_s: float, told: Reported, row: int) -> None:
        """Count P(dark) and P(silent) of the track of a ship."""
        figures = self.figures
        self._since.setdefault(ship, now_s)
        # Whether a ship that lies is dark is a question of words.
        if KINDS[ship] == LIAR and now_s > LIES_S:
            return
        if KINDS[ship] != DARK:
            figures["ship_hours"][KINDS[ship]] += TURN_S / 3600.0
        if now_s > SETTLING_S:
            figures["dark_said"].append(float(told.dark[row]))
            figures["dark_true"].append(KINDS[ship] == DARK)
            if np.isfinite(told.silent[row]):
                figures["silent_said"].append(float(told.silent[row]))
                figures["silent_true"].append(KINDS[ship] in (DARK, BOAT))

    def _call_dark(self, called: set[int], now_s: float) -> None:
        for ship in called - self._dark:
            place = ship - KINDS.index(DARK)
            if KINDS[ship] != DARK:
                lies = KINDS[ship] == LIAR and now_s > LIES_S
                self.figures["false_dark"][KINDS[ship]] += not lies
            elif self.figures["calls"][place] is None:
                self.figures["calls"][place] = now_s - self._since[ship]
        self._dark = called

    def _call_doubtful(self, told: Reported, now_s: float) -> None:
        """Count calls of sources, of which a shared address has several, and P(doubtful)."""
        named = told.space == MMSI
        doubted = set(told.address[named & (told.doubtful > ALARM)].tolist())
        liar = self._addresses[KINDS.index(LIAR)]
        # Of a source that owns a track it is what is missing of the owner's probability.
        doubt = np.where(told.alone == 1, told.doubtful, 1.0 - told.owned)
        lies = named & (told.address == liar) & (now_s > LIES_S)
        # A lie of some seconds is within the errors.
        known = named & np.isfinite(doubt) & (now_s > SETTLING_S)
        # A ship that her source has left is named by it, and is where the radar has her.
        known &= ((told.alone == 1) | (told.reason != LEFT)) & ~(
            lies & (now_s < LIES_S + LIKE_TRUTH_S)
        )
        self.figures["doubtful_said"] += doubt[known].tolist()
        self.figures["doubtful_true"] += lies[known].tolist()
        heard = set(told.address[named].tolist()) - ({liar} if now_s > LIES_S else set())
        self.figures["source_hours"] += len(heard) * TURN_S / 3600.0
        self.figures["false_doubts"] += len((doubted - self._doubted) & heard)
        calls, heard_calls = (self.figures[name][self._lie] for name in LIAR_CALLS)
        if now_s > LIES_S and liar in doubted and calls[0] is None:
            calls[0], heard_calls[0] = now_s - LIES_S, max(now_s - self._lied_s, 0.0)
        self._doubted = doubted


def _measure(arguments: argparse.Namespace, seed: int) -> Figures:
    rng = np.random.default_rng([seed, len(KINDS)])
    radar, both = resolve(RADAR), resolve(RADAR | RECEIVER)
    duration_s = DURATION_S if arguments.minutes is None else 60.0 * arguments.minutes
    seen, lie = scene(radar, duration_s, rng), LIES[seed % len(LIES)]
    own = STEADY if arguments.steady else AIS
    plots, told = simulate_reports(seen, radar.radars, seed), received(seen, lie, rng, own)
    scores, (alone, joint) = (
        Scores(seen, lie, told),
        ([*_tracked(radar, plots, [])], [*_tracked(both, plots, told)]),
    )
    for estimates in zip(alone, joint, strict=True):
        scores.add(*estimates)
    scores.add_owners()
    figures, calibrated = scores.figures, {}
    for name in CALIBRATED:
        said, true = (
            np.array(figures.pop(f"{name}_{each}"), dtype=float) for each in ("said", "true")
        )
        calibrated[name] = binned(BOUNDS, said, true)
    figures["calibrated"] = calibrated
    receiver = {key: value for key, value in (RADAR | RECEIVER).items() if key[:6] != "radar."}
    reports = _tracked(resolve(receiver | {"sensors": ["ais"]}), [], told)
    stamps = [each.stamp_ns for each in joint]
    of_peer = follow(plots, seen.radars, stamps, SHIPS)
    confirmed = {RADAR_ALONE: alone, BOTH: joint, REPORTS_ALONE: reports}
    figures["trackers"] = {
        **{
            name: _errors(seen, ((e.stamp_ns, e.position[e.track_state > 0]) for e in own))
            for name, own in confirmed.items()
        },
        PEER: _errors(seen, ((t, e.position) for t, e in zip(stamps, of_peer, strict=True))),
    }
    return figures


def _combined(found: Sequence[Figures]) -> Figures:
    def every(name: str) -> list[Any]:
        return [value for own in found for value in own[name]]

    totals = ("false_doubts", "owned", "wrong", "source_hours")
    trackers = [own["trackers"] for own in found]
    several = {"half_width": {"trackers": runner.half_width(trackers)}} if len(found) > 1 else {}
    rms = {name: float(np.sqrt(np.mean(np.square(every(name))))) for name in ("radar", "joint")}
    return {
        "runs": len(found),
        "rms": rms,
        "nees": float(np.mean(every("nees"))),
        "calls": _times(every("calls")),
        **{
            name: {
                lie: _times([time_s for own in found for time_s in own[name].get(lie, ())])
                for lie in LIES
            }
            for name in LIAR_CALLS
        },
        **{name: sum(own[name] for own in found) for name in totals},
        **{
            name: {kind: sum(own[name][kind] for own in found) for kind in TRUE_KINDS}
            for name in ("false_dark", "ship_hours")
        },
        "changes": np.sum([own["changes"] for own in found], axis=0).tolist(),
        "trackers": runner.mean(trackers),
        **several,
        "calibration": {
            name: _calibration([own["calibrated"][name] for own in found]) for name in CALIBRATED
        },
    }


def _times(calls: Sequence[float | None]) -> Figures:
    """Return how many of the calls came, and their median and largest time, seconds."""
    made = [each for each in calls if each is not None]
    median, largest = (float(np.median(made)), max(made)) if made else (None, None)
    return {"of": len(calls), "called": len(made), "median_s": median, "largest_s": largest}


def _calibration(found: Sequence[Reliability]) -> dict[str, list[float | None]]:
    """Return the columns of `Bins` over runs; entries of bins without estimates are None."""
    bins = pooled(Reliability(*map(np.array, zip(*found, strict=True))))
    return {
        name: [None if math.isnan(each) else float(each) for each in column]
        for name, column in bins._asdict().items()
    }


def _tables(figures: Figures) -> list[Table | str]:
    rms, ship_h, source_h = figures["rms"], figures["ship_hours"], figures["source_hours"]
    false = figures["false_dark"]
    ratio = rms["joint"] / rms["radar"]
    shown = f"{ratio:.2f} ({rms['radar']:.1f} to {rms['joint']:.1f} m), NEES {figures['nees']:.2f}"
    rows = [
        ("RMS of ships with AIS, relative to the radar alone", shown),
        ("dark ships called, after their confirmation", _shown(figures["calls"])),
        *(
            (f"called dark, but is not: {kind}", _rate(false[kind], ship_h[kind], "ship"))
            for kind in TRUE_KINDS
        ),
        *(
            (f"{text}, {lie}", _shown(each))
            for name, text in LIAR_CALLS.items()
            for lie, each in figures[name].items()
        ),
        ("false doubts", _rate(figures["false_doubts"], source_h, "source")),
        (f"wrong owners at P > {ALARM}", f"{figures['wrong']} of {figures['owned']}"),
        ("changes of track numbers", "{1}, of the radar alone {0}".format(*figures["changes"])),
    ]
    columns = {"found": ("found", ".1%"), "rms": ("RMS", ".1f", "m")}
    paths = {name: ("trackers", name) for name in TRACKERS}
    return [
        runner.table(f"harbours, {figures['runs']} runs", ("figure", "value"), rows),
        runner.figures_table("ships with AIS", "tracker", figures, columns, paths),
        *(_bins(f"P({name})", name, figures["calibration"][name]) for name in CALIBRATED),
    ]


def _bins(title: str, true: str, columns: Mapping[str, Sequence[float | None]]) -> Table:
    bins = [
        (
            f"{low:.2f} to {high:.2f}",
            f"{number:.0f}",
            *("-" if each is None else f"{each:.3f}" for each in (said, right)),
            "-" if least is None else f"{least:.2f} to {most:.2f}",
        )
        for (low, high), (number, said, right, least, most) in zip(
            pairwise(BOUNDS), zip(*columns.values(), strict=True), strict=True
        )
    ]
    headings = ("probability", "estimates", "said", f"are {true}", "95 % interval")
    return runner.table(title, headings, bins)


def _pictures(figures: Figures) -> dict[str, Figure]:
    """Return the reliability diagram."""
    rows = {
        name: {"harbours": Bins(*(np.array(each, dtype=float) for each in columns.values()))}
        for name, columns in figures["calibration"].items()
    }
    return {"reports_reliability.png": draw(rows, dict.fromkeys(rows, BOUNDS), TOLERANCE)}


def _shown(times: Figures) -> str:
    text = f"{times['called']} of {times['of']}"
    if times["called"]:
        text += f", median {times['median_s']:.0f} s, largest {times['largest_s']:.0f} s"
    return text


def _rate(count: float, hours: float, of: str) -> str:
    return f"{count:.0f} in {hours:.1f} {of} hours, {count / hours:.2f} an hour"


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--steady", action="store_true", help="no ship is of class B or hidden for a while"
    )


STUDY = Study(
    name="self_reports",
    purpose="How well ships' own reports are joined with the tracks of a radar.",
    measure=_measure,
    tables=_tables,
    seed=900,
    runs=12,
    least_minutes=4.0,
    combined=_combined,
    pictures=_pictures,
    add_arguments=_add_arguments,
)
