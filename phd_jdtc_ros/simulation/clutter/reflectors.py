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

from phd_jdtc_ros.configuration.schema import Parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from ..checked import mappings, take
from ..noise import Observed, with_noise
from .law import NOISE, ClutterLaw, law_of

REFLECTORS = (
    Parameter("points", [0.0, 0.0], "x and y of points, world frame, m.", -1e7, 1e7, required=True),
    Parameter(
        "spacing",
        0.0,
        "Distance between reflectors on the line through the points, m; 0: only the points.",
        0.0,
        1e6,
    ),
    Parameter(
        "detection_probability",
        0.5,
        "Of each reflector per scan or turn.",
        0.0,
        1.0,
        required=True,
    ),
)
# Largest number of points of a line, which bounds the memory for a small spacing.
MOST = 10_000


@dataclass(frozen=True)
class Reflectors:
    """Reflectors of one kind."""

    points: tuple[tuple[float, float], ...]  # Positions in the world frame, metres
    # Probability of detection of a point per scan or turn if it is in a radar's coverage.
    detection_probability: float
    law: ClutterLaw = NOISE  # Law of the envelopes

    def measure(self, exact: FloatArray, radar: RadarModel, rng: np.random.Generator) -> Observed:
        """Return a radar's measurements of reflectors at true ranges and azimuths, (N, 2)."""
        found = rng.random(len(exact)) < self.detection_probability
        visible = radar.visibility.sees(exact) > 0.0
        amplitude = self.law.draw(radar.threshold, len(exact), rng)
        return Observed(with_noise(exact, radar, rng), amplitude, found & visible)


def reflectors(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Reflectors, ...]:
    """Return the kinds of reflectors in a scenario document; add faults to `faults`."""
    kinds = []
    for index, given in enumerate(mappings(document, "reflectors", "", faults)):
        prefix, found = f"reflectors[{index}].", list[str]()
        values = take(REFLECTORS, given, prefix, found, ("amplitude",))
        # The bounds of a law follow from the threshold; the highest threshold is the strictest.
        strictest = max(radars, key=lambda radar: radar.threshold)
        law: ClutterLaw = NOISE
        if "amplitude" in given:
            law = law_of(given["amplitude"], f"{prefix}amplitude.", strictest, found)
        if not found and (not values["points"] or len(values["points"]) % 2):
            found.append(f"{prefix}points: must be x and y of at least one point")
        faults += found
        if found:
            continue
        corners = np.reshape(values["points"], (-1, 2))
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        if values["spacing"] and length / values["spacing"] > MOST:
            faults.append(
                f"{prefix}spacing: {values['spacing']:g} given, must be at least "
                f"{length / MOST:g} for at most {MOST} reflectors"
            )
            continue
        kinds.append(
            Reflectors(_along(corners, values["spacing"]), values["detection_probability"], law)
        )
    return tuple(kinds)


def _along(corners: FloatArray, spacing: float) -> tuple[tuple[float, float], ...]:
    """Return points at most `spacing` apart on the line through corners, corners included."""
    points = [tuple(corners[0].tolist())]
    for begin, end in itertools.pairwise(corners):
        parts = max(math.ceil(math.dist(begin, end) / spacing - 1e-9), 1) if spacing else 1
        share = np.arange(1, parts + 1)[:, None] / parts
        points += map(tuple, (begin + share * (end - begin)).tolist())
    return tuple((float(x), float(y)) for x, y in points)
