"""The parameters of a sensor of any kind; `tables` lists the kinds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, TypeVar

from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.gaussians import STANDARD_AIR, Air, HeightPrior
from phd_jdtc_ros.core.sensors.site import Plane

from ..schema import parameter
from . import place_forms

S = TypeVar("S", bound="SensorParameters")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Fields:
    """Names of a message's fields by quantity; empty for a quantity that is not used.

    A kind of sensor declares the quantities that its messages may have.
    """

    amplitude = ""
    time = ""
    height = ""
    code = ""
    address = ""
    detection_type = ""


@dataclass(frozen=True)
class Units:
    """Units and conventions of a message's fields."""

    time: str = "s"
    time_reference: str = "stamp"
    amplitude: str = "linear"
    azimuth: str = "rad"
    azimuth_convention: str = "enu_ccw"
    elevation: str = "rad"

    @cached_property
    def time_s(self) -> float:
        """The unit of times, seconds."""
        return TIME_UNITS[self.time]

    @cached_property
    def since_epoch(self) -> bool:
        """Whether times count from the zero of the stamps."""
        return self.time_reference == "epoch"

    @cached_property
    def in_db(self) -> bool:
        """Whether amplitudes are SNRs in decibels."""
        return self.amplitude == "db"

    @cached_property
    def in_degrees(self) -> bool:
        """Whether azimuths are in degrees."""
        return self.azimuth == "deg"

    @cached_property
    def compass(self) -> bool:
        """Whether azimuths count clockwise from north."""
        return self.azimuth_convention == "compass_cw"

    @cached_property
    def elevation_scale(self) -> tuple[float, float]:
        """Elevation at the value 0, and of one unit beyond it, radians."""
        sense, _, unit = self.elevation.rpartition("_")
        zero, sign = _SENSES[sense]
        return zero, sign * _RADIANS[unit]


# Angle that the values count from, radians above the horizon, and whether they count upwards.
_SENSES = {"": (0.0, 1.0), "down": (0.0, -1.0), "zenith": (0.5 * math.pi, -1.0)}
_RADIANS = {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3}
UNITS: Mapping[str, tuple[str, ...]] = {
    "time": tuple(TIME_UNITS),
    "time_reference": ("stamp", "epoch"),
    "amplitude": ("linear", "db"),
    "azimuth": ("rad", "deg"),
    "azimuth_convention": ("enu_ccw", "compass_cw"),
    "elevation": (*_RADIANS, "down_rad", "down_deg", "zenith_rad", "zenith_deg"),
}


@dataclass(frozen=True)
class SensorParameters:
    """The parameters that every sensor has, with its name.

    A kind of sensor is a subclass with further parameters. The tracker reads some of them of every
    sensor; the attributes without annotation are their values for a sensor that lacks them.
    """

    # Last part of the name of its usual topic.
    TOPIC: ClassVar[str] = "detections"
    # Parameter and unit of the noise of each component of a measurement that may be learned.
    noise_parameters: ClassVar[Mapping[str, tuple[str, str]]] = {}
    # True if its antenna may turn: the rotation is then estimated from the azimuths of detections.
    may_turn: ClassVar[bool] = False
    # True if a message without amplitudes deserves a warning, as classes are inferred from them.
    measures_amplitude: ClassVar[bool] = False

    kind: str = parameter("radar", "Kind of the sensor.")
    topic: str = parameter("", "Topic of the detections; empty for /NAME/detections.")
    frame: str = parameter("", "frame_id of the messages; empty for the sensor's name.")
    name: str = ""
    # Heights of undetected targets in space; None in the plane.
    height_prior: HeightPrior | None = None
    air: Air = STANDARD_AIR  # Pressure altitudes of targets in space

    message = ""  # Type of the messages, if a kind has several
    fields = Fields()
    units = Units()
    pose_max_age_s = 0.0
    rotation_s = 0.0
    sectors = 0
    clutter_map = False
    clutter_map_speed = 0.0
    tilt_deg: Sequence[float] = (0.0, 0.0)

    @cached_property
    def bias(self) -> SensorBias:
        """Biases that are removed from its measurements."""
        return NO_BIAS

    @cached_property
    def pose(self) -> place_forms.PoseSource:
        """The topic of its platform's poses, and their use."""
        return place_forms.NO_POSE

    @property
    def height(self) -> float:
        """Height of the sensor above the world's zero, metres."""
        return 0.0

    def on_earth(self: S, plane: Plane) -> S:
        """Return the sensor with its place on the earth, given the world's map projection."""
        return self

    def in_space(self: S, prior: HeightPrior, air: Air) -> S:
        """Return the sensor in a world with heights, given those of undetected targets."""
        return replace(self, height_prior=prior, air=air)
