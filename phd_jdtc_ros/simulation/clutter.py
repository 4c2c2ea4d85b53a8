"""False detections of a scenario: the blocks ``clutter``, ``echoes`` and ``reflectors``.

The simulated law of amplitudes may differ from the tracker's assumption, its parameter
`clutter_amplitude`. A radar of high resolution detects bumpers, wheels and corners of a vehicle
separately: echoes. Reflectors are fixed in the world, such as quays, land and wind turbines; every
radar that has them in its coverage reports them as false detections, also from a moving platform.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.special import ndtr, ndtri

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Parameter, parameter
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import StateSpace
from phd_jdtc_ros.core.targets.amplitude_density import (
    DB_PER_NEPER,
    SMALLEST_AMPLITUDE,
    level_db,
    snr_from_db,
)
from phd_jdtc_ros.core.types import FULL_TURN

from .antenna import Observation, with_noise
from .checked import (
    by_radar,
    converted_parameter,
    degrees,
    mappings,
    pair,
    read,
    read_by_radar,
    take,
)

LAW = Parameter(
    "law",
    "rayleigh",
    "Law of the envelopes.",
    choices=("rayleigh", "log_normal", "uniform"),
    required=True,
)
LEVELS_DB = (-100.0, 200.0)


@dataclass(frozen=True)
class RayleighClutter:
    """Noise, or clutter of many reflectors."""

    # Mean square of the envelope relative to that of noise; 1 is noise.
    level: float = converted_parameter(
        0.0, "Mean level, dB.", LEVELS_DB, snr_from_db, "level_db", required=True
    )

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        # The square of a Rayleigh envelope is exponential, so the truncated draw is exact.
        square = threshold**2 + 2.0 * self.level * rng.standard_exponential(count)
        envelope: FloatArray = np.sqrt(square)
        return envelope


@dataclass(frozen=True)
class LogNormalClutter:
    """Clutter whose level in dB is Gaussian."""

    median_db: float = parameter(0.0, "Median level, dB.", LEVELS_DB, "level_db", required=True)
    std_db: float = parameter(6.0, "Standard deviation, dB.", (0.1, 100.0), required=True)

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        least = (_level(threshold) - self.median_db) / self.std_db
        share = np.maximum(rng.random(count) * ndtr(-least), np.finfo(float).tiny)
        return _envelope(self.median_db - self.std_db * ndtri(share))


@dataclass(frozen=True)
class UniformClutter:
    """Clutter whose level is uniform in dB."""

    lowest_db: float = parameter(0.0, "Lowest level, dB.", LEVELS_DB, required=True)
    highest_db: float = parameter(0.0, "Highest level, dB.", LEVELS_DB, required=True)

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        lowest = max(self.lowest_db, _level(threshold))
        return _envelope(rng.uniform(lowest, self.highest_db, count))


ClutterLaw: TypeAlias = RayleighClutter | LogNormalClutter | UniformClutter
NOISE = RayleighClutter(1.0)


def read_clutter(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[ClutterLaw, ...]:
    """Return every radar's law, by default noise; empty if all are noise; add faults."""
    given = by_radar(document, "clutter", radars, faults)
    if not given:
        return ()
    return tuple(
        law_of(given[radar.name], f"clutter.{radar.name}.", radar, faults)
        if radar.name in given
        else NOISE
        for radar in radars
    )


def law_of(given: Any, prefix: str, radar: RadarModel, faults: list[str]) -> ClutterLaw:
    """Return a checked law; add its faults to `faults` and return noise if there are any."""
    laws = {
        "rayleigh": RayleighClutter,
        "log_normal": LogNormalClutter,
        "uniform": UniformClutter,
    }
    if not isinstance(given, Mapping):
        faults.append(f"{prefix[:-1]}: must be a mapping")
        return NOISE
    declared = laws.get(str(given.get("law")))
    if declared is None:
        take((LAW,), given, prefix, faults)
        return NOISE
    law = read(declared, given, prefix, faults, ("law",))
    if isinstance(law, UniformClutter):
        least = max(law.lowest_db, _level(radar.threshold))
        if law.highest_db <= least:
            faults.append(
                f"{prefix}highest_db: {law.highest_db:g} given, must be above lowest_db and the "
                f"radar's threshold, {least:.1f} dB"
            )
    return law or NOISE


def _level(threshold: float) -> float:
    """Return the level of an envelope, dB."""
    return float(level_db(np.array(max(threshold, SMALLEST_AMPLITUDE))))


def _envelope(level: FloatArray) -> FloatArray:
    """Return the envelopes of levels in dB."""
    envelope: FloatArray = np.sqrt(2.0 * np.exp(level / DB_PER_NEPER))
    return envelope


@dataclass(frozen=True)
class Echoes:
    """Further detections of targets by one radar in a scan."""

    probability: float = parameter(
        0.3, "Probability that a detected target has further detections.", (0.0, 1.0)
    )
    most: int = parameter(2, "Their largest number; all up to it are equally probable.", (1, 100))
    length_std: float = parameter(
        1.2, "Their standard deviation along the course, m.", (SMALL, 1e3)
    )
    width_std: float = parameter(
        0.5, "Their standard deviation across the course, m.", (SMALL, 1e3)
    )

    def sources(
        self, state: FloatArray, space: StateSpace, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return the states of the echoes' sources, (E, D), and the row of each one's target, (E,).

        `state`, shape (N, D), has the states of the detected targets.
        """
        more = rng.random(len(state)) < self.probability
        count = np.where(more, rng.integers(1, self.most + 1, len(state)), 0)
        row = np.arange(len(state)).repeat(count)
        spread = rng.standard_normal((len(row), 2)) * [self.length_std, self.width_std]
        echo = state[row]
        velocity = echo[:, list(space.velocity)]
        course = np.arctan2(velocity[:, 1], velocity[:, 0])
        cos, sin = np.cos(course), np.sin(course)
        x, y = space.position
        echo[:, x] += cos * spread[:, 0] - sin * spread[:, 1]
        echo[:, y] += sin * spread[:, 0] + cos * spread[:, 1]
        return echo, row


def read_echoes(
    document: Mapping[str, object], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Echoes | None, ...]:
    """Return every radar's echoes, None for a radar without; empty if no radar has any."""
    echoes = tuple(read_by_radar(Echoes, document, "echoes", radars, faults))
    faults += [
        f"echoes.{radar.name}: given, must be absent for a turning radar"
        for radar, own in zip(radars, echoes, strict=True)
        if own is not None and radar.rotation_s
    ]
    return echoes if any(echoes) else ()


@dataclass(frozen=True)
class Mirror:
    """A surface that reflects the replies of targets in some directions."""

    position: tuple[float, float] = pair("Position, world frame, m.", required=True)
    # The directions are seen from the radar.
    start: float = degrees(
        0.0,
        "First azimuth of reflected targets, clockwise from the y axis, degrees.",
        (-360.0, 360.0),
        "start_deg",
        required=True,
    )
    width: float = degrees(
        360.0, "Width of these azimuths, degrees.", (SMALL, 360.0), "width_deg", required=True
    )
    probability: float = parameter(
        0.1, "Probability of a reflection in each revolution.", (0.0, 1.0), required=True
    )

    def reflects(
        self, position: FloatArray, radar: RadarModel, rng: np.random.Generator
    ) -> BoolArray:
        """Return which replies from positions in the world, shape (N, 2), are reflected."""
        east, north = (position - radar.position).T
        turned = np.mod(np.arctan2(east, north) - self.start, FULL_TURN)
        drawn = rng.random(len(position)) < self.probability
        found: BoolArray = drawn & (turned < self.width)
        return found

    def detour(self, position: FloatArray, radar: RadarModel) -> FloatArray:
        """Return the increase of the ranges by the reflection, metres, shape (N,)."""
        own = math.dist(self.position, radar.position)
        longer: FloatArray = (
            own + np.hypot(*(position - self.position).T) - np.hypot(*(position - radar.position).T)
        )
        return longer


# Largest number of points of a line, which bounds the memory for a small spacing.
MOST = 10_000


@dataclass(frozen=True)
class ReflectorBlock:
    """Reflectors of one kind in a document, without their amplitudes."""

    points: list[float] = parameter(
        [0.0, 0.0], "x and y of points, world frame, m.", (-1e7, 1e7), required=True
    )
    detection_probability: float = parameter(
        0.5,
        "Detection probability of each reflector per scan or revolution.",
        (0.0, 1.0),
        required=True,
    )
    spacing: float = parameter(
        0.0,
        "Distance between reflectors on the line through the points, m; 0: only the points.",
        (0.0, 1e6),
    )

    def __post_init__(self) -> None:
        if not self.points or len(self.points) % 2:
            raise ConfigError("points: must be x and y of at least one point")
        length = float(np.hypot(*np.diff(self.corners, axis=0).T).sum())
        if self.spacing and length / self.spacing > MOST:
            raise ConfigError(
                f"spacing: {self.spacing:g} given, must be at least {length / MOST:g} for at "
                f"most {MOST} reflectors"
            )

    @property
    def corners(self) -> FloatArray:
        """The points, shape (N, 2)."""
        return np.reshape(self.points, (-1, 2))


@dataclass(frozen=True)
class Reflectors:
    """Reflectors of one kind."""

    points: tuple[tuple[float, float], ...]  # Positions in the world frame, metres
    # Probability of detection of a point per scan or revolution if it is in a radar's coverage.
    detection_probability: float
    law: ClutterLaw = NOISE  # Law of the envelopes

    def measure(
        self, exact: FloatArray, radar: RadarModel, rng: np.random.Generator
    ) -> Observation:
        """Return a radar's measurements of reflectors at true ranges and azimuths, (N, 2)."""
        found = rng.random(len(exact)) < self.detection_probability
        visible = radar.visibility.probability_in_view(exact) > 0.0
        amplitude = self.law.draw(radar.threshold, len(exact), rng)
        return Observation(with_noise(exact, radar, rng), amplitude, found & visible)


def reflectors(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Reflectors, ...]:
    """Return the kinds of reflectors in a scenario document; add faults to `faults`."""
    kinds = []
    for index, given in enumerate(mappings(document, "reflectors", "", faults)):
        prefix = f"reflectors[{index}]."
        block = read(ReflectorBlock, given, prefix, faults, ("amplitude",))
        law: ClutterLaw = NOISE
        if "amplitude" in given:
            # The bounds of a law follow from the threshold; the highest one is the strictest.
            strictest = max(radars, key=lambda radar: radar.threshold)
            law = law_of(given["amplitude"], f"{prefix}amplitude.", strictest, faults)
        if block is not None:
            points = _along(block.corners, block.spacing)
            kinds.append(Reflectors(points, block.detection_probability, law))
    return tuple(kinds)


def _along(corners: FloatArray, spacing: float) -> tuple[tuple[float, float], ...]:
    """Return points at most `spacing` apart on the line through corners, corners included."""
    points = [tuple(corners[0].tolist())]
    for begin, end in itertools.pairwise(corners):
        parts = max(math.ceil(math.dist(begin, end) / spacing - 1e-9), 1) if spacing else 1
        share = np.arange(1, parts + 1)[:, None] / parts
        points += map(tuple, (begin + share * (end - begin)).tolist())
    return tuple((float(x), float(y)) for x, y in points)
