"""One sensor of positions: its parameters, and how its messages are read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import ClassVar

from phd_jdtc_ros.core.sensors.position import Area
from phd_jdtc_ros.core.sensors.site import Plane

from ..schema import POSITIVE, SMALL, parameter, shared
from . import place_forms, radar, sensor
from .radar import MOST_PROBABILITY, RadarParameters
from .sensor import UNITS, SensorParameters, Units

# The words of `learn`, each with the parameters from whose values learning starts.
LEARNED: Mapping[str, tuple[str, ...]] = {
    word: ("position_std",) if word == "noise" else begin
    for word, begin in radar.LEARNED.items()
    if word in ("noise", "outliers", "detection", "clutter")
}


@dataclass(frozen=True)
class Fields(sensor.Fields):
    """Names of a position sensor's fields."""

    x: str = "x"  # Metres, in the sensor's frame
    y: str = "y"
    z: str = "z"  # Metres above the sensor; only in space
    x_std: str = "x_std"
    y_std: str = "y_std"
    z_std: str = "z_std"
    correlation: str = "correlation"  # Of the errors in x and y
    vx: str = "vx"  # Metres per second over ground, along the sensor's axes
    vy: str = "vy"
    vz: str = "vz"  # Upward; only in space
    velocity_std: str = ""
    area_x_min: str = "area_x_min"  # Of the area that the cloud covers, the same in all points
    area_y_min: str = "area_y_min"
    area_x_max: str = "area_x_max"
    area_y_max: str = "area_y_max"
    amplitude: str = ""
    time: str = ""
    height: str = ""
    code: str = ""
    address: str = ""
    detection_type: str = ""


QUANTITIES = tuple(entry.name for entry in fields(Fields))


@dataclass(frozen=True)
class PositionParameters(SensorParameters):
    """The parameters of a sensor whose detections are places."""

    noise_parameters: ClassVar[Mapping[str, tuple[str, str]]] = {
        "x": ("position_std", "m"),
        "y": ("position_std", "m"),
    }

    message: str = parameter(
        "positions",
        "Type of the messages: positions for sensor_msgs/PointCloud2 with x and y, detections_3d "
        "for vision_msgs/Detection3DArray, where that package is installed.",
        choices=("positions", "detections_3d"),
    )
    position: tuple[float, ...] = shared(RadarParameters, "position")
    yaw_deg: float = shared(RadarParameters, "yaw_deg")
    pose_topic: str = shared(RadarParameters, "pose_topic")
    pose_message: str = shared(RadarParameters, "pose_message")
    pose_max_age_s: float = shared(RadarParameters, "pose_max_age_s")
    area: Area = parameter(
        [-1000.0, -1000.0, 1000.0, 1000.0],
        "Area in which targets are detected, in the sensor's frame, m: least x and y, and largest "
        "x and y; or x and y of each corner of a polygon. Detections outside are ignored.",
        form=place_forms.AREA,
    )
    learn: list[str] = parameter(
        ["noise", "detection", "clutter"],
        "What is learned from the detections, beginning with the values of the parameters: noise "
        "(position_std, within a factor of 4), outliers (the share of detections with several "
        "times that noise), detection (by which factor detection_probability differs, by place), "
        "clutter (clutter_rate, over about the last 30 scans).",
        element=str,
        choices=tuple(LEARNED),
        mutable=True,
    )
    position_std: float = parameter(
        0.5,
        "Standard deviation of a measured position along each axis, m, of detections without "
        "their own.",
        POSITIVE,
        mutable=True,
    )
    velocity_std: float = parameter(
        0.5,
        "Standard deviation of a measured velocity along each axis, m/s, of detections without "
        "their own.",
        (1e-3, 1e3),
        mutable=True,
    )
    detection_probability: float = parameter(
        0.9,
        "Probability that a target in the area is detected in a scan.",
        (SMALL, MOST_PROBABILITY),
        mutable=True,
    )
    clutter_rate: float = shared(RadarParameters, "clutter_rate")
    cluster_distance: float = shared(RadarParameters, "cluster_distance")
    false_alarm_probability: float = shared(RadarParameters, "false_alarm_probability")
    amplitude_offset_db: float = shared(RadarParameters, "amplitude_offset_db")
    fields: Fields = parameter(
        Fields(),
        "Names of the cloud's fields by quantity, such as fields.x_std; empty for an unused "
        "quantity. Fields of deviations, correlations and velocities that a cloud lacks are "
        "unknown; z, z_std and vz are only used with state: space. area_x_min, area_y_min, "
        "area_x_max and area_y_max, the same in all points, replace the area for a cloud.",
        keys=dict.fromkeys(QUANTITIES, ()),
    )
    units: Units = parameter(
        Units(),
        "Units of the cloud's fields of times and amplitudes, as those of a radar.",
        keys={key: UNITS[key] for key in ("time", "time_reference", "amplitude")},
    )

    datum: float = 0.0  # Height of the world's zero as messages count heights, metres

    def on_earth(self, plane: Plane) -> PositionParameters:
        """Return the sensor with the datum of its heights."""
        return replace(self, datum=plane.origin[2])

    @cached_property
    def pose(self) -> place_forms.PoseSource:
        """The topic of the platform's poses, and their use."""
        return place_forms.pose_source(self.pose_topic, self.pose_message)

    @property
    def height(self) -> float:
        """Height of the sensor above the world's zero, metres."""
        return self.position[2]
