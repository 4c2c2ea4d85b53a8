"""Fixed clutter such as quays, land and wind turbines; a scenario's ``reflectors``.

Reflectors are fixed in the world. Every radar that has them in its coverage reports them as false
detections, also from a moving platform.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.schema import ConfigError, parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from ..checked import mappings, read
from ..noise import Observation, with_noise
from .law import NOISE, ClutterLaw, law_of

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
