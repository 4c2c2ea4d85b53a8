"""One receiver of self-reports: its parameters, and how its messages are read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from phd_jdtc_ros.core.reports.model import Receiver
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types.reports import SPACES

from ..schema import SMALL, parameter
from .sensor import SensorParameters


@dataclass(frozen=True)
class ReportsParameters(SensorParameters):
    """The parameters of a receiver of what transmitters report of themselves.

    Reports are beside the tracks of other sensors, which they do not change, as sources may lie.
    Positions that cannot lie are those of a sensor of ``kind: position``.
    """

    TOPIC: ClassVar[str] = "reports"

    message = "reports"
    identity: str = parameter(
        "mmsi",
        "Identity space of the addresses in clouds without a field space: mmsi of ships, icao of "
        "aircraft, number of another tracker's tracks, or other.",
        choices=tuple(space for space in SPACES if space),
    )
    offset_std: float = parameter(
        40.0,
        "Standard deviation of an antenna's place ahead of the middle of its target, m, and a "
        "fifth of it to the left: half of a usual ship's length; 5 for aircraft.",
        (SMALL, 500.0),
        mutable=True,
    )
    obliged: list[str] = parameter(
        [],
        "Names of the classes whose targets are obliged to transmit. Without any, silent targets "
        "are reported, and none is called dark.",
        element=str,
        mutable=True,
    )
    max_age_s: float = parameter(
        10.0, "Age up to which reports are used, s.", (0.0, 600.0), mutable=True
    )
    coverage: list[float] = parameter(
        [],
        "Area in which transmitters are heard: x and y of each corner of a polygon in the world, "
        "m; empty if it is learned from the reports.",
        mutable=True,
    )

    # The map projection of latitudes and longitudes; None without `world_origin`.
    plane: Plane | None = None

    def on_earth(self, plane: Plane) -> ReportsParameters:
        """Return the receiver with the map projection of its reports."""
        return replace(self, plane=plane)

    def receiver(self, classes: list[str]) -> Receiver:
        """Return the model of the receiver, given the names of the classes of targets."""
        return Receiver(
            name=self.name,
            space=SPACES.index(self.identity),
            offset_std=self.offset_std,
            obliged=np.array([float(name in self.obliged) for name in classes]),
            max_age_s=self.max_age_s,
            coverage=np.reshape(self.coverage, (-1, 2)),
        )
