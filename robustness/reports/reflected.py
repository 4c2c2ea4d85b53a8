"""Replies that are measured far from their aircraft, beside a second aircraft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Detections, Estimates, Scan
from phd_jdtc_ros.parameter_files import from_arguments

from ..harness.figures import Found, measures, such_as

NS, START_NS, REVOLUTION_S, REVOLUTIONS = 10**9, 10**15, 4.0, 36
ADDRESSES = np.array([0x345678, 0x342FFF])
CODES = np.array([0o4463, 0o5545])
# A and B 830 m apart, metres east and north of the radar; nothing detects B in these revolutions.
PLACES = np.array([[-1950.0, -868.0], [-2740.0, -1110.0]])
HIDDEN = range(13, 20)
# Direction from A to B. An aircraft that had gone there would soon be at B.
TOWARDS = (PLACES[1] - PLACES[0]) / np.hypot(*(PLACES[1] - PLACES[0]))
# The revolution from which A must be right, and the one from which B must be so again, whose new
# track needs three plots.
SETTLED, RIGHT_FROM = 6, 23
NEAR = 100.0
NOISE = np.array([5.0, np.radians(0.01)])
PARAMETERS = {
    "sensors": ["radar"],
    "classes": ["aircraft"],
    "motions": ["cv", "hard"],
    "aircraft.motions": ["cv", "hard"],
    "aircraft.mode_transition": [0.95, 0.05, 0.2, 0.8],
    "aircraft.survival_probability": 0.999,
    "interval_s": REVOLUTION_S,
    "amplitude": "none",
    "births": [],
    "detection_births.rates": [0.2],
    "detection_births.std": [100.0],
    "existence": [0.97, 0.8],
    "cv.noise_density": 1.0,
    "hard.model": "coordinated_turn",
    "hard.noise_density": 100.0,
    "hard.turn_noise_density": 4e-3,
    "radar.range_std": float(NOISE[0]),
    "radar.azimuth_std_deg": float(np.degrees(NOISE[1])),
    "radar.detection_probability": 0.99,
    "radar.clutter_rate": 1.0,
    "radar.min_range": 500.0,
    "radar.max_range": 1.1e5,
    "radar.clutter_max_range": 1.1e5,
    "radar.fields.amplitude": "",
    "radar.fields.code": "code",
    "radar.fields.address": "address",
}
# Velocity of both aircraft, m/s, and how far the plots of A are from it towards B, by revolution.
CASES: Mapping[str, tuple[tuple[float, float], Mapping[int, float]]] = {
    "parked, once by 100 m": ((0.0, 0.0), {19: 100.0}),
    "parked, once by 320 m": ((0.0, 0.0), {19: 320.0}),
    "parked, once by 1 km": ((0.0, 0.0), {19: 1e3}),
    "parked, once by 10 km": ((0.0, 0.0), {19: 1e4}),
    "parked, twice at different places": ((0.0, 0.0), {19: 320.0, 20: -400.0}),
    "in the air, once by 320 m": ((-120.0, 90.0), {19: 320.0}),
    "in the air, once by 1 km": ((-120.0, 90.0), {19: 1e3}),
}


@measures(
    "far reply of one identity beside a second aircraft",
    "0 revolutions wrong, and no number of both",
)
def measure(cases: Sequence[str] = tuple(CASES)) -> Found:
    """Track two aircraft of which one is measured elsewhere for a revolution or two."""
    wrong = {case: count for case in cases if (count := _wrong_revolutions(*CASES[case]))}
    counted = len(cases) * (REVOLUTIONS - SETTLED)
    text = f"{sum(wrong.values())} of {counted} revolutions wrong{such_as(wrong)}"
    return text, not wrong, {"cases": list(cases), "wrong": wrong}


def _wrong_revolutions(velocity: tuple[float, float], shifted: Mapping[int, float]) -> int:
    """Count the revolutions in which an aircraft is not right, and the numbers of both."""
    config = from_arguments.config_of({**PARAMETERS})
    tracker, rng, wrong = new_engine(config), np.random.default_rng(14), 0
    numbers: list[set[int]] = [set(), set()]
    for revolution in range(REVOLUTIONS):
        place = PLACES + REVOLUTION_S * revolution * np.array(velocity)
        seen = [0] if revolution in HIDDEN else [0, 1]
        plots = place + np.outer([shifted.get(revolution, 0.0), 0.0], TOWARDS)
        found = Detections(
            _measured(plots[seen], rng), None, code=CODES[seen], address=ADDRESSES[seen]
        )
        stamp_ns = START_NS + round(revolution * REVOLUTION_S * NS)
        (estimates,) = tracker.step(Scan(stamp_ns, (found,))).filtered
        own = [_number_near(estimates, index, place[index]) for index in range(2)]
        for known, number in zip(numbers, own, strict=True):
            known.update({number} - {0})
        # A may be wrong only in the revolution of a reflection.
        due = (
            own
            if revolution >= RIGHT_FROM
            else own[: revolution >= SETTLED and revolution not in shifted]
        )
        wrong += 0 in due
    return wrong + len(set.intersection(*numbers))


def _measured(position: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return ranges and azimuths of positions, with noise, (M, 2)."""
    east, north = position.T
    exact = np.stack([np.hypot(east, north), np.arctan2(north, east)], axis=1)
    return exact + NOISE * rng.standard_normal(exact.shape)


def _number_near(estimates: Estimates, index: int, place: FloatArray) -> int:
    """Return the number of the track of an aircraft with its address near it; 0 without any."""
    near = np.hypot(*(estimates.position - place).T) < NEAR
    if estimates.attributes is None:
        return 0
    own = np.flatnonzero(near & (estimates.attributes.address == ADDRESSES[index]))
    return int(estimates.track_id[own[0]]) if len(own) else 0
