"""One radar: its parameters, which are declared here, and how its messages are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

from phd_jdtc_ros.core.factors import MOST_CORRELATION, START_RATE
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.site import Plane, Site

from ..schema import NOT_NEGATIVE, POSITIVE, SMALL, Form, number, numbers, parameter
from . import place_forms, replaced, sensor
from .sensor import UNITS, SensorParameters, Units

# Largest number of clouds in a revolution.
MOST_SECTORS = 256
# A target with a detection probability of 1 would be deleted at its first missed detection.
MOST_PROBABILITY = 0.999
# The words of `learn`, each with the parameters from whose values learning starts.
LEARNED: Mapping[str, tuple[str, ...]] = {
    "noise": ("range_std", "azimuth_std_deg", "elevation_std_deg", "range_rate_std"),
    "outliers": (),
    "detection": ("detection_probability", "detection_probability_range"),
    "correlation": ("detection_correlation",),
    "clutter": ("clutter_rate", "clutter_density", "clutter_density_range"),
    "multipath": (),
}


def _probabilities(given: Any) -> float | list[float] | None:
    """Return a probability or a list of some above 0; None if they are not allowed."""
    constant = number(given, 0.0, MOST_PROBABILITY)
    return (numbers(given, SMALL, MOST_PROBABILITY) or None) if constant is None else constant


PROBABILITIES = Form(
    f"a number from 0 to {MOST_PROBABILITY}, or a list of numbers above 0 and at most "
    f"{MOST_PROBABILITY}",
    _probabilities,
)


@dataclass(frozen=True)
class Fields(sensor.Fields):
    """Names of a radar's fields."""

    range: str = "range"  # Metres; slant ranges if there are elevations or heights
    azimuth: str = "azimuth"
    elevation: str = ""  # Above the sensor's plane, in the unit of elevations
    amplitude: str = "amplitude"
    time: str = ""
    sector: str = ""
    height: str = ""  # Metres; above the world's zero plus the radar's datum, or in the atmosphere
    code: str = ""  # Mode A
    address: str = ""  # Mode S
    detection_type: str = ""  # See `Detections`
    range_std: str = ""
    azimuth_std: str = ""  # In the unit of the azimuth
    elevation_std: str = ""  # In the unit of elevations
    range_rate: str = ""  # Metres per second, positive for a receding target
    range_rate_std: str = ""


QUANTITIES = tuple(entry.name for entry in fields(Fields))


@dataclass(frozen=True)
class RadarParameters(SensorParameters):
    """The parameters of a radar, with its place on the earth."""

    noise_parameters: ClassVar[Mapping[str, tuple[str, str]]] = {
        "range": ("range_std", "m"),
        "azimuth": ("azimuth_std_deg", "\N{DEGREE SIGN}"),
        "elevation": ("elevation_std_deg", "\N{DEGREE SIGN}"),
        "range_rate": ("range_rate_std", "m/s"),
    }
    may_turn: ClassVar[bool] = True
    measures_amplitude: ClassVar[bool] = True

    message: str = parameter(
        "point_cloud",
        "Type of the messages: sensor_msgs/PointCloud2, or radar_msgs/RadarScan, whose definition "
        "fixes fields, units and conventions.",
        choices=("point_cloud", "radar_scan"),
    )
    position: tuple[float, ...] = parameter(
        [0.0, 0.0],
        "Position of the sensor in the world frame, x and y, and optionally the height of its "
        "antenna above the world's zero, m.",
        form=place_forms.POSITION,
    )
    geodetic: list[float] = parameter(
        [],
        "Latitude and longitude of the radar (WGS84, degrees) and height of its antenna (m), "
        "instead of position. Set it, with world_origin, for slant ranges over the round earth and "
        "azimuths from true north. The height alone if the place is unknown, as in world_origin.",
        form=place_forms.PLACE_OR_HEIGHT,
    )
    yaw_deg: float = parameter(
        0.0,
        "Direction of the sensor's x axis, degrees counter-clockwise from the x axis of the world "
        "frame, or from true east with geodetic.",
        (-360.0, 360.0),
    )
    pose_topic: str = parameter(
        place_forms.FIXED,
        "Topic of the poses of a moving radar's platform in the world frame; position and yaw_deg "
        "are then in the platform's frame. With tf the transforms on /tf and /tf_static place the "
        "radar's frame in world_frame, and position and yaw_deg are 0.",
        name="pose",
        form=place_forms.POSE,
        former=replaced.pose,
    )
    pose_message: str = parameter(
        place_forms.POSE_MESSAGES[0],
        "Type of the messages on the topic of pose: nav_msgs/Odometry or "
        "geometry_msgs/PoseStamped. It is the same for all platforms.",
        choices=place_forms.POSE_MESSAGES,
    )
    pose_yaw: bool = parameter(
        True, "Whether azimuths turn with the platform; false for a radar with stabilised azimuths."
    )
    pose_max_age_s: float = parameter(
        1.0,
        "Longest time between a detection and the nearest pose, s: the platform is extrapolated "
        "and detections wait for a pose for at most this long.",
        (0.0, 60.0),
    )
    learn: list[str] = parameter(
        ["noise", "outliers", "detection", "clutter"],
        "What is learned from the detections, beginning with the values of the parameters: noise "
        "(range_std, azimuth_std_deg, elevation_std_deg and range_rate_std, within a factor of 4), "
        "outliers (the "
        "share of detections with several times that noise), detection (by which factor "
        "detection_probability differs, by range and azimuth), correlation "
        "(detection_correlation), clutter (clutter_rate, over about the last 30 revolutions, and "
        "clutter_density). With multipath false detections behind targets are expected. The "
        "default is [] with a PHD filter.",
        element=str,
        choices=tuple(LEARNED),
        mutable=True,
    )
    range_std: float = parameter(
        300.0,
        "Standard deviation of measured ranges, m.",
        POSITIVE,
        mutable=True,
        former=replaced.learned_by("noise"),
    )
    azimuth_std_deg: float = parameter(
        1.0,
        "Standard deviation of measured azimuths, degrees.",
        (SMALL, 180.0),
        mutable=True,
        former=replaced.learned_by("noise"),
    )
    elevation_std_deg: float = parameter(
        1.0,
        "Standard deviation of measured elevations, degrees; only with state: space.",
        (SMALL, 90.0),
        mutable=True,
    )
    max_range: float = parameter(
        17e3, "Range beyond which targets and detections are ignored, m.", POSITIVE
    )
    min_range: float = parameter(
        0.0,
        "Range below which targets and detections are ignored, m. The detections are dropped and "
        "counted as those beyond max_range are: set it to leave out sea clutter around the radar.",
        NOT_NEGATIVE,
        mutable=True,
    )
    fov_deg: list[float] = parameter(
        [0.0, 360.0],
        "First and last azimuth of the field of view, degrees, counted as the radar counts "
        "azimuths.",
        (-360.0, 720.0),
        length=2,
    )
    tilt_deg: list[float] = parameter(
        [0.0, 0.0],
        "Pitch of a tilted array, by which its x axis points up, and roll, by which its left side "
        "is up, degrees: azimuths and elevations are in its frame. Only with state: space, and "
        "without geodetic.",
        (-90.0, 90.0),
        length=2,
    )
    fov_elevation_deg: list[float] = parameter(
        [-90.0, 90.0],
        "Lowest and highest elevation of the field of view, degrees; only with state: space.",
        (-90.0, 90.0),
        length=2,
    )
    blind_sectors_deg: list[float] = parameter(
        [],
        "First and last azimuth of each blind sector in the field of view, degrees, counted as in "
        "fov_deg.",
        (-360.0, 720.0),
    )
    detection_probability: float | list[float] = parameter(
        0.0,
        "Probability that a target is detected in a scan or a revolution: a number for all "
        "ranges, or one for each of detection_probability_range. 0 derives it from the classes' "
        "SNR bands and false_alarm_probability.",
        form=PROBABILITIES,
        mutable=True,
        former=replaced.detection_probability,
    )
    detection_probability_range: list[float] = parameter(
        [],
        "Ranges of a list of detection probabilities, m, ascending: the probability is linear "
        "between them, and constant beyond the first and the last.",
        NOT_NEGATIVE,
        mutable=True,
    )
    detection_correlation: float = parameter(
        0.0,
        "Probability of a detection after a detection of the same target minus that after a miss: "
        "above 0 if misses are correlated, as in shadows.",
        (0.0, MOST_CORRELATION),
        mutable=True,
    )
    rotation_s: float = parameter(
        0.0,
        "Approximate time of a revolution of the antenna, s; 0 finds out whether the antenna "
        "turns, and estimates it.",
        (0.0, 1e3),
        former=replaced.rotation,
    )
    sectors: int = parameter(
        0,
        "Number of clouds per revolution; 0 if a cloud is a whole revolution or detections have "
        "times of their own.",
        (0, MOST_SECTORS),
    )
    cluster_distance: float = parameter(
        0.0,
        "Distance within which detections of a scan with consistent range rates or velocities are "
        "merged, m. Set it for sensors with several detections per target; 0 merges none.",
        (0.0, 1e4),
        mutable=True,
    )
    clutter_rate: float = parameter(
        START_RATE,
        "Expected false detections per scan or revolution, not counting those that clutter_map has "
        "learned.",
        (0.0, 1e6),
        mutable=True,
        former=replaced.learned_by("clutter"),
    )
    clutter_max_range: float = parameter(
        15e3,
        "Range up to which false detections are uniformly distributed in range and azimuth, m. "
        "clutter_rate counts them from range 0 on, also below min_range.",
        POSITIVE,
        mutable=True,
    )
    clutter_density: list[float] = parameter(
        [],
        "Relative density of false detections in range, one number for each of "
        "clutter_density_range; clutter_rate is still their number. Empty for a uniform density, "
        "from which learning starts.",
        (SMALL, 1e6),
        mutable=True,
    )
    clutter_density_range: list[float] = parameter(
        [],
        "Ranges of a list of densities of false detections, m, ascending: the density is linear "
        "between them, and constant beyond the first and the last.",
        NOT_NEGATIVE,
        mutable=True,
    )
    clutter_map: bool = parameter(
        False,
        "Learn a map of false detections, so that fixed reflectors do not become targets. The map "
        "of a moving radar is in the world frame and needs engine: gaussian.",
    )
    clutter_map_speed: float = parameter(
        2.5,
        "Speed below which targets are not reported and count as clutter of the map, m/s; 0 keeps "
        "stationary targets.",
        (0.0, 1e3),
        mutable=True,
    )
    clutter_amplitude: str = parameter(
        "rayleigh",
        "Distribution of false detections' amplitudes: that of noise (rayleigh), or learned.",
        choices=("rayleigh", "learned"),
        former=replaced.clutter_amplitude,
    )
    false_alarm_probability: float = parameter(
        1e-3,
        "Probability that noise exceeds the detection threshold; it determines the threshold.",
        (1e-30, 0.999),
        mutable=True,
    )
    fields: Fields = parameter(
        Fields(),
        "Names of the cloud's fields by quantity, such as fields.time; empty for an unused "
        "quantity. The tracker's page gives their units; an elevation or a height makes ranges "
        "slant ranges. In space heights are pressure altitudes, see qnh_hpa.",
        keys=dict.fromkeys(QUANTITIES, ()),
    )
    units: Units = parameter(
        Units(),
        "Units and conventions of the cloud's fields, such as units.azimuth. time is relative to "
        "the message's stamp, or by time_reference to the zero of the stamps (epoch); amplitude "
        "is an envelope in standard deviations of the noise per quadrature (linear) or an SNR "
        "(db). Azimuths count counter-clockwise from the sensor's x axis (enu_ccw) or clockwise "
        "from north (compass_cw), and elevations from the horizon, with down_rad and down_deg for "
        "depression angles, as of a sonar, and zenith_rad and zenith_deg for angles from the "
        "zenith.",
        keys=UNITS,
    )
    assumed_height: float | None = parameter(
        [],
        "Height of targets without a measured height, m, counted as in world_origin; only with "
        "geodetic. Empty for the antenna's height.",
        form=place_forms.HEIGHT,
    )
    range_rate_std: float = parameter(
        0.1,
        "Standard deviation of range rates, m/s.",
        (1e-3, 1e3),
        mutable=True,
        former=replaced.learned_by("noise"),
    )
    range_rate_ambiguity: float = parameter(
        0.0,
        "Interval modulo which range rates are measured, m/s; 0 for unambiguous range rates.",
        (0.0, 1e4),
        mutable=True,
    )
    amplitude_offset_db: float = parameter(
        0.0,
        "Correction added to every amplitude, dB. Set it if the driver's reference level is not "
        "the noise.",
        (-300.0, 300.0),
        mutable=True,
    )
    biases: SensorBias = parameter(
        [0.0, 0.0, 0.0, 0.0],
        "Biases that are subtracted from range (m), range per range, azimuth (degrees, in the "
        "radar's direction) and time (s; positive for late stamps). register estimates them.",
        form=place_forms.BIASES,
    )
    # Site on the round earth; None for a radar that measures over a plane.
    site: Site | None = None
    datum: float = 0.0  # Height of the world's zero as messages count heights, metres

    @cached_property
    def pose(self) -> place_forms.PoseSource:
        """The topic of the platform's poses, and their use."""
        return place_forms.pose_source(self.pose_topic, self.pose_message, self.pose_yaw)

    def on_earth(self, plane: Plane) -> RadarParameters:
        """Return the radar with its site and the datum of its heights."""
        place, yaw = self.geodetic, math.radians(self.yaw_deg)
        site = Site((place[0], place[1], place[2]), plane, yaw) if place else None
        return replace(self, site=site, datum=plane.origin[2])

    @property
    def curvature(self) -> float:
        """Curvature of the earth about the radar, 1/m; 0 over a plane."""
        return 0.0 if self.site is None else self.site.curvature

    @property
    def height(self) -> float:
        """Height of the antenna above the world's zero, metres."""
        return self.position[2] if self.site is None else self.site.geodetic[2] - self.datum

    @property
    def named_fields(self) -> bool:
        """Whether messages have fields and conventions by configuration, not by definition."""
        return self.message == "point_cloud"

    @property
    def sense(self) -> float:
        """Direction of the radar's azimuths: -1 clockwise, 1 counter-clockwise."""
        return -1.0 if self.units.compass and self.named_fields else 1.0

    @cached_property
    def bias(self) -> SensorBias:
        """Biases that are removed from its measurements, azimuths counter-clockwise."""
        return replace(self.biases, azimuth=self.biases.azimuth * self.sense)

    def bias_parameters(self, bias: SensorBias) -> dict[str, list[float]]:
        """Return the parameter for these biases, by dotted name."""
        azimuth_deg = math.degrees(bias.azimuth) * self.sense
        found = [bias.range_bias, bias.range_gain, azimuth_deg, bias.time_offset_s]
        return {f"{self.name}.biases": found}
