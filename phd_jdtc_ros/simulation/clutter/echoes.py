"""Targets that give several detections in a scan, and the block ``echoes`` of a scenario document.

To a radar of high resolution a vehicle is not a point: bumpers, wheels and corners answer apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.configuration.schema import SMALL, Parameter
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import StateSpace

from ..checked import mapping, names_of, take

ECHOES = (
    Parameter("probability", 0.3, "Probability that a detected target has more.", 0.0, 1.0),
    Parameter("most", 2, "Largest number of further detections; each is as probable.", 1, 100),
    Parameter("length_std", 1.2, "Their spread along the target's course, m.", SMALL, 1e3),
    Parameter("width_std", 0.5, "Their spread across the target's course, m.", SMALL, 1e3),
)


@dataclass(frozen=True)
class Echoes:
    """How targets answer to one radar more than once in a scan.

    Parameters
    ----------
    probability : float
        That a detected target has further detections.
    most : int
        Their largest number; every number from 1 is as probable.
    length_std, width_std : float
        Standard deviations of where they come from, along the target's course and across it,
        metres.
    """

    probability: float
    most: int
    length_std: float
    width_std: float

    def sources(
        self, state: FloatArray, space: StateSpace, rng: np.random.Generator
    ) -> tuple[FloatArray, IntArray]:
        """Return where further detections of targets come from, and the row of the target of each.

        Parameters
        ----------
        state : array of shape (N, D)
            Of the targets that are detected.
        space : StateSpace
        rng : numpy.random.Generator

        Returns
        -------
        state : array of shape (E, D)
        row : int array of shape (E,)
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
    """Return every radar's echoes, None where none are given; empty if none are; add faults."""
    given = mapping(document, "echoes", faults)
    known = {radar.name: radar for radar in radars}
    faults += [
        f"echoes.{name}: must be one of the radars, {', '.join(known)}"
        for name in given
        if name not in known
    ]
    faults += [
        f"echoes.{name}: given, must not be for a radar that turns"
        for name in given
        if name in known and known[name].rotation_s
    ]
    found: list[Echoes | None] = []
    for name in known:
        of_radar, wrong = mapping(given, name, faults), list[str]()
        values = take(ECHOES, of_radar, f"echoes.{name}.", wrong, names_of(ECHOES))
        faults += wrong
        found.append(Echoes(**values) if name in given and not wrong else None)
    return tuple(found) if given else ()
