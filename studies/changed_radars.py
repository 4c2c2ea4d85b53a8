"""How soon a tracker says that a radar has changed, and how often it says so wrongly.

A radar of the reference scenario changes half-way through: it detects fewer targets, its noise
rises, or it has a blind sector. The tracker learns detection probability and noise.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from rich.table import Table

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.simulation.simulate import simulate

from .misspecified import LEARNED, RADARS, of_radars, scenario_of, truth_of
from .runner import Figures, Goal, Study, goal, table

# The first scan after the change.
CHANGE = 40
# Azimuths of the blind sector, radians: two of the four targets cross it.
BLIND = (0.8, 1.6)
DETECTIONS, NOISE = {"detection_probability": 0.5}, {"range_std": 2.0, "azimuth_std_deg": 2.0}
# Factors of the configured values: of all radars from the start, and of the first one later.
CASES: Mapping[str, tuple[Mapping[str, float], Mapping[str, float]]] = {
    "no change": ({}, {}),
    "no change, noise x 2 from the start": (NOISE, NOISE),
    "no change, detection x 0.5 from the start": (DETECTIONS, DETECTIONS),
    "detection x 0.5": ({}, DETECTIONS),
    "noise x 2": ({}, NOISE),
    "blind sector": ({}, {"blind": 1.0}),
}
# The figures of a step that say which change was found.
ALARMS = ("fewer_detections", "blind_azimuth_deg", "range_noisier", "azimuth_noisier")
RIGHT: Mapping[str, tuple[str, ...]] = {
    "detection x 0.5": ALARMS[:1],
    "noise x 2": ALARMS[2:],
    "blind sector": ALARMS[1:2],
}
# Largest number of scans until a change is found.
MOST_SCANS = 20


def measure(_: argparse.Namespace, seed: int) -> Figures:
    """Return the first scan with each alarm of the changed radar, by case."""
    return {"cases": {case: _first(seed, *CASES[case]) for case in CASES}}


def _first(seed: int, before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, int]:
    tracker = new_engine(resolve(of_radars(LEARNED)))
    first: dict[str, int] = {}
    for index, scan in enumerate(_scans(seed, before, after)):
        for name in tracker.step(scan).figures:
            radar, _, alarm = name.partition(".")
            if alarm in ALARMS:
                first.setdefault(alarm if radar == RADARS[0] else name, index)
    return first


def _scans(seed: int, before: Mapping[str, float], after: Mapping[str, float]) -> Iterator[Scan]:
    """Yield scans whose first radar is another one from the scan `CHANGE` on."""
    both = zip(_simulated(seed, before), _simulated(seed, after), strict=True)
    for index, (usual, changed) in enumerate(both):
        if index < CHANGE:
            yield usual
            continue
        first = changed.detections[0]
        if first is not None and "blind" in after:
            first = _with_blind_sector(first)
        yield replace(usual, detections=(first, *usual.detections[1:]))


def _simulated(seed: int, factors: Mapping[str, float]) -> list[Scan]:
    return [scan for _, scan in simulate(scenario_of(truth_of(factors)), seed)]


def _with_blind_sector(detections: Detections) -> Detections:
    azimuth = np.mod(detections.measurement[:, 1], 2.0 * np.pi)
    return detections.take(np.flatnonzero((azimuth < BLIND[0]) | (azimuth > BLIND[1])))


def _delays(case: str, found: Sequence[Mapping[str, int]]) -> list[float]:
    """Return the scans from the change to the first right alarm of each run; inf for none."""
    return [
        min((own[alarm] - CHANGE for alarm in RIGHT[case] if alarm in own), default=math.inf)
        for own in found
    ]


def _false(case: str, found: Sequence[Mapping[str, int]]) -> int:
    """Return the runs with an alarm before the change, or without one, or of the other radar."""
    last = CHANGE if case in RIGHT else math.inf
    return sum(any(at < last or "." in name for name, at in own.items()) for own in found)


def _combined(found: Sequence[Figures]) -> Figures:
    return {"cases": {case: [own["cases"][case] for own in found] for case in CASES}}


def tables(figures: Figures) -> list[Table]:
    """Return how many runs have false and right alarms, and after how many scans."""
    rows = []
    for case, found in figures["cases"].items():
        row = [case, f"{_false(case, found)} of {len(found)}", "", ""]
        if case in RIGHT:
            delays = _delays(case, found)
            row[2] = f"{sum(map(math.isfinite, delays))} of {len(found)}"
            longest = f"{max(delays):g}" if max(delays) < math.inf else "not found"
            row[3] = f"{np.median(delays):g} / {longest}"
        rows.append(row)
    headings = ("radar", "false alarms", "found", "scans, median / longest")
    return [table("A radar that changes", headings, rows)]


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: no false alarm, and every change found soon."""
    found = []
    for case, runs in figures["cases"].items():
        found.append(goal(f"changed radars, {case}, false alarms", _false(case, runs), 0))
        if case in RIGHT:
            late = sum(delay > MOST_SCANS for delay in _delays(case, runs))
            name = f"changed radars, {case}, runs that take more than {MOST_SCANS} scans"
            found.append(goal(name, late, 0))
    return found


STUDY = Study(
    name="changed_radars",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    goals=goals,
    seed=67000,
    runs=12,
    in_summary="changed_radars",
    combined=_combined,
)
