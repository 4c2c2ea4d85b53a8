"""Several detections of a target in a scan; the block ``echoes`` of a scenario document.

A radar of high resolution detects bumpers, wheels and corners of a vehicle separately.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, parameter
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import StateSpace

from ..checked import read_by_radar


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


def of_radars(
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
