"""The parameters of one radar, below its name."""

from __future__ import annotations

from dataclasses import dataclass

from phd_jdtc_ros.core.clutter.rate import START_RATE

from . import forms
from .schema import SMALL, parameter, table

# The clutter rate of a radar that learns it.
AUTO = "auto"
# The quantities that a field of a cloud may have, and those that every radar has unless its
# parameters say otherwise.
QUANTITIES = (
    *("range", "azimuth", "elevation", "amplitude", "time", "sector", "height", "code", "address"),
    *("kind", "range_std", "azimuth_std", "range_rate", "range_rate_std"),
)
USUAL_FIELDS = {"range": "range", "azimuth": "azimuth", "amplitude": "amplitude"}


@dataclass(frozen=True)
class Radar:
    """What a radar has."""

    kind: str = parameter("radar", "What the sensor is.", choices=("radar",))
    message: str = parameter(
        "point_cloud",
        "Message type of its topic. point_cloud: sensor_msgs/PointCloud2; radar_scan: "
        "radar_msgs/RadarScan, whose definition fixes fields, units and conventions.",
        choices=("point_cloud", "radar_scan"),
    )
    topic: str = parameter("", "Topic of its detections; /NAME/detections if empty.")
    frame: str = parameter("", "frame_id of its clouds; the radar's name if empty.")
    position: list[float] = parameter(
        [0.0, 0.0],
        "Position of the radar in the world frame, x and y, m; and the height of its antenna above "
        "the world's zero, m, 0 if it is left out.",
        form=forms.POSITION,
    )
    geodetic: list[float] = parameter(
        [],
        "Latitude and longitude of the radar, degrees (WGS84), and height of its antenna, m, "
        "instead of position; needs world_origin. Its ranges are then slant ranges over "
        "the round earth, and its azimuths are from true north. Empty: position says where it is.",
        -1e4,
        1e4,
    )
    yaw_deg: float = parameter(
        0.0,
        "Direction of the radar's x axis in the world frame, counter-clockwise from x, degrees; "
        "with geodetic from true east.",
        -360.0,
        360.0,
    )
    pose: str = parameter(
        forms.FIXED,
        "Where the radar is. fixed: at position and yaw_deg; a topic: on a platform whose poses in "
        "the world frame come there (nav_msgs/Odometry, or geometry_msgs/PoseStamped with "
        "pose_stamped after the topic), at position and yaw_deg in the platform's frame. With "
        "stabilised after it azimuths are not turned with the platform, as those from north.",
        form=forms.POSE,
    )
    pose_max_age_s: float = parameter(
        1.0,
        "Farthest that a detection may be from the nearest pose, s: so long a platform is "
        "extrapolated with its last velocity, and detections wait for poses.",
        0.0,
        60.0,
    )
    range_std: float = parameter(300.0, "Standard deviation of the range, m.", SMALL, mutable=True)
    azimuth_std_deg: float = parameter(
        1.0, "Standard deviation of the azimuth, degrees.", SMALL, 180.0, mutable=True
    )
    range_std_growth: float = parameter(
        0.0,
        "What the standard deviation of the range grows by with the range, m per m; the two are "
        "added as squares.",
        0.0,
        1.0,
        mutable=True,
    )
    max_range: float = parameter(
        17e3, "Range beyond which targets and detections are ignored, m.", SMALL
    )
    min_range: float = parameter(
        0.0, "Range below which targets are not detected, m.", 0.0, mutable=True
    )
    fov_deg: list[float] = parameter(
        [0.0, 360.0],
        "Field of view: from this azimuth to that one, in the direction in which the radar counts "
        "azimuths, degrees.",
        -360.0,
        720.0,
        length=2,
    )
    blind_sectors_deg: list[float] = parameter(
        [],
        "Hidden azimuths in the field of view, from and to, from and to, and so on, counted as in "
        "fov_deg; empty for none.",
        -360.0,
        720.0,
    )
    detection_probability: float | list[float] = parameter(
        0.0,
        "Probability to detect a target in a scan or a turn; or range (m) and probability, range "
        "and probability, and so on, with rising ranges and linear in between. 0: it follows from "
        "the classes' SNR bands and false_alarm_probability.",
        form=forms.PROBABILITY,
        mutable=True,
    )
    rotation_s: float = parameter(
        0.0,
        "First guess of the time of one turn of the antenna, s; 0 for one that does not turn, or "
        "of which that is found out.",
        0.0,
        1e3,
    )
    sectors: int = parameter(
        0,
        "Number of clouds that the radar publishes in a turn; 0 if a cloud is a whole turn, or "
        "detections have times of their own.",
        0,
        256,
    )
    cluster_distance: float = parameter(
        0.0,
        "Distance within which detections of one scan, with range rates that agree, count as one, "
        "m; for radars that see a vehicle as several points. 0 for none.",
        0.0,
        1e4,
        mutable=True,
    )
    clutter_rate: float | str = parameter(
        START_RATE,
        "Expected false detections per scan, or per turn; with clutter_map those that come from "
        "nowhere in particular. auto: the tracker learns it from what no target claims, some 30 "
        f"scans back; it begins with {START_RATE:g}.",
        0.0,
        1e6,
        words=(AUTO,),
        mutable=True,
    )
    clutter_max_range: float = parameter(
        15e3,
        "Range up to which false detections are uniform in range and azimuth, m.",
        SMALL,
        mutable=True,
    )
    clutter_map: bool = parameter(
        False,
        "Learn where false detections come from: a map of the radar's range and azimuth, so that "
        "what answers at the same place turn after turn does not become a target. Of a radar that "
        "moves it is a map of the world, with engine gaussian only.",
    )
    clutter_map_speed: float = parameter(
        2.5,
        "Targets that are probably slower than this are not reported, and their detections count "
        "as clutter in the map, m/s; 0: those at rest stay targets, once they are.",
        0.0,
        1e3,
        mutable=True,
    )
    clutter_amplitude: str = parameter(
        "rayleigh",
        "Law of the amplitudes of false detections. rayleigh: that of noise, or as many dB above "
        "it as follow; log_normal: of the median SNR that follows, dB, and a standard deviation of "
        "6 dB; learned: as what no target claims tells it.",
        form=forms.CLUTTER,
    )
    false_alarm_probability: float = parameter(
        1e-3,
        "Probability that noise exceeds the detection threshold; determines the threshold.",
        1e-30,
        0.999,
        mutable=True,
    )
    fields: dict[str, str] = parameter(
        dict(USUAL_FIELDS),
        "Names of the cloud's fields by quantity, such as fields.range; empty for one that is not "
        "to be used. Not given, range, azimuth and amplitude are found by their usual names, and "
        "the others are not used. elevation and height, m above the world's zero, say that ranges "
        "are slant ranges; time has a unit and a zero, see time_unit; sector counts from 0; code "
        "is a Mode A code, a whole number of 12 bits, and address a Mode S address of 24 bits, "
        "4294967295 if they are unknown; kind is the TYP of I048/020; range_std, azimuth_std and "
        "range_rate_std are each detection's own standard deviations; range_rate is positive "
        "where a target recedes, m/s (with radar_scan any name: use its doppler_velocity).",
        keys=QUANTITIES,
    )
    time_unit: str = parameter(
        "s", "Unit of the detections' times.", choices=("s", "ms", "us", "ns")
    )
    time_reference: str = parameter(
        "stamp",
        "stamp: the detections' times are relative to the cloud's stamp; epoch: they count from "
        "the zero of the stamps.",
        choices=("stamp", "epoch"),
    )
    assumed_height: list[float] = parameter(
        [],
        "Height of targets whose height is not known, m, counted as those of world_origin; only "
        "with geodetic. Empty: that of the antenna.",
        -1e4,
        1e5,
    )
    range_rate_std: float = parameter(
        0.1, "Standard deviation of the range rate, m/s.", 1e-3, 1e3, mutable=True
    )
    range_rate_ambiguity: float = parameter(
        0.0,
        "Interval modulo which the radar measures range rates, m/s; 0 if they are not ambiguous.",
        0.0,
        1e4,
        mutable=True,
    )
    amplitude_unit: str = parameter(
        "linear",
        "linear: an envelope in units of the noise's standard deviation per quadrature; db: SNR.",
        choices=("linear", "db"),
    )
    amplitude_offset_db: float = parameter(
        0.0, "Added to every amplitude, dB.", -300.0, 300.0, mutable=True
    )
    azimuth_convention: str = parameter(
        "enu_ccw",
        "enu_ccw: from the sensor's x axis, counter-clockwise; compass_cw: from north, clockwise.",
        choices=("enu_ccw", "compass_cw"),
    )
    azimuth_unit: str = parameter("rad", "Unit of the azimuth: rad or deg.", choices=("rad", "deg"))
    range_bias: float = parameter(
        0.0,
        "What its ranges are too long by, m; it is subtracted as they are read. register finds it, "
        "and the next three.",
        -1e5,
        1e5,
    )
    range_gain: float = parameter(
        0.0, "What its ranges are too long by in addition, m per m of range.", -0.5, 0.5
    )
    azimuth_bias_deg: float = parameter(
        0.0,
        "What its azimuths are too large by, in the direction in which it counts them, degrees.",
        -180.0,
        180.0,
    )
    time_offset_s: float = parameter(
        0.0,
        "What its stamps and its detections' times are late by, s; negative if they are early.",
        -60.0,
        60.0,
    )


RADAR = table(Radar)
