"""Recognises sensors of positions that are configured as radars, by their clouds.

A cloud with x and y and without a range is of no use for a radar. The first ones are held until
they show the sensor's noise and area, as `tune` finds them; none is lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from msg_adapters.encoding.errors import RejectedMessageError
from msg_adapters.incoming import positions
from msg_adapters.incoming.recognised import is_of_positions
from phd_jdtc_ros.calibration.tuning import proposal, unspecified
from phd_jdtc_ros.calibration.tuning.findings import findings
from phd_jdtc_ros.calibration.tuning.plots import limit_plots, plots_of
from phd_jdtc_ros.calibration.tuning.rates import area_of
from phd_jdtc_ros.columns.position_selection import EVERYWHERE
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters

# Numbers of clouds after which their noise is sought, and after which the defaults are used.
FIRST, LAST = 40, 320
# Parameters that describe targets: without any of them the clouds do.
OF_TARGETS = ("classes", "motions", "births", "detection_births.rates")


class Held(NamedTuple):
    """A cloud that waits."""

    sensor: int  # Index of its sensor
    cloud: PointCloud2
    info: Mapping[str, int]


@dataclass
class Recognition:
    """Holds the clouds of one sensor of positions at a time."""

    config: TrackerConfig
    given: Mapping[str, Any]  # Parameters that the user has set
    held: list[Held] = field(default_factory=list)
    _due: int = FIRST
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1))
    _search: Future[dict[str, Any] | None] | None = None
    _given_up: bool = False

    @property
    def sensor(self) -> SensorParameters:
        """The sensor whose clouds wait."""
        return self.config.inputs[self.held[0].sensor]

    def give_up(self) -> None:
        """Hold no more clouds."""
        self.held, self._given_up = [], True

    def holds(self, sensor: int, message: Any, info: Mapping[str, int]) -> bool:
        """Return whether a message waits here because it is of positions, and no radar's."""
        own = self.config.inputs[sensor]
        is_radar = isinstance(own, RadarParameters) and own.named_fields
        if not is_radar or self._given_up or not isinstance(message, PointCloud2):
            return False
        if self.held and self.held[0].sensor != sensor:
            return False
        if not is_of_positions(point_cloud.field_names(message)):
            return False
        frame = message.header.frame_id
        usual = self.held[0].cloud.header.frame_id if self.held else frame
        # Without a configured frame that of the clouds is the sensor's.
        if frame != (own.frame if f"{own.name}.frame" in self.given else usual):
            return False
        self.held.append(Held(sensor, message, info))
        return True

    def found(self) -> dict[str, Any] | None:
        """Return the changes of the parameters, by dotted name; None until they are known."""
        if self._search is None and len(self.held) >= self._due:
            last, clouds = self._due >= LAST, [each.cloud for each in self.held]
            self._due *= 2
            with_targets = not any(name in self.given for name in OF_TARGETS)
            # The search takes seconds, in which further clouds are received.
            self._search = self._pool.submit(_changes, self.sensor, clouds, with_targets, last)
        if self._search is None or not self._search.done():
            return None
        changes, self._search = self._search.result(), None
        if changes is None:
            return None
        return {name: value for name, value in changes.items() if name not in self.given}


def _changes(
    own: SensorParameters, clouds: list[PointCloud2], with_targets: bool, last: bool
) -> dict[str, Any] | None:
    """Return the parameters that clouds show; None if they are too few and not the `last`."""
    name, reports, frame = own.name, [], clouds[0].header.frame_id
    sensor = PositionParameters(name=name, frame=frame, area=EVERYWHERE)
    for cloud in clouds:
        try:
            report = positions.from_msg(cloud, sensor)
        except RejectedMessageError:
            continue
        reports.append((report.stamp_ns, report.detections))
    changes: dict[str, Any] = {f"{name}.kind": "position"}
    if frame != own.frame:
        changes[f"{name}.frame"] = frame
    places = [found.measurement for _, found in reports if len(found)]
    if not places:
        return changes if last else None
    changes[f"{name}.area"] = [*area_of(np.concatenate(places))]
    try:
        plots = plots_of(reports, places=True)
        found = findings(limit_plots(plots))
    except ValueError:  # `TuningError`, or numbers with which nothing can be computed
        return changes if last else None
    found = replace(found, field=replace(found.field, area=area_of(plots.measurement)))
    if with_targets:
        changes |= unspecified.parameters({name: found}, {name: plots.timed})
    changes["interval_s"] = proposal.interval_s({name: found})
    rows = proposal.rows(found, {}, name)
    return changes | {f"{name}.{row.name}": row.value for row in rows if row.proposed}
