"""The layout of one radar's messages: topic, fields, units and conventions."""

from __future__ import annotations

import math
from dataclasses import dataclass

from phd_jdtc_ros.core.sensors.bias import NO_BIAS, RadarBias
from phd_jdtc_ros.core.sensors.site import Site


@dataclass(frozen=True)
class RadarInput:
    """The layout of one radar's messages, by default that of the package's own clouds.

    Parameters
    ----------
    name, topic, frame : str
    message : str
        ``point_cloud`` or ``radar_scan``.
    range_field, azimuth_field, elevation_field, amplitude_field : str
        Names of the point cloud's fields. `amplitude_field` is empty if there is none, and
        `elevation_field` is empty if the ranges are ground ranges.
    amplitude_in_db : bool
        Whether the amplitude field is an SNR in dB and not a linear envelope.
    amplitude_offset_db : float
    compass : bool
        Whether azimuths are clockwise from north.
    azimuth_in_degrees : bool
        Whether azimuths are in degrees and not in radians.
    max_range : float
        Metres; detections beyond it are dropped.
    time_field : str
        Name of the field with each detection's own time; empty if there is none.
    time_unit_s : float
        Unit of that field, seconds.
    time_since_epoch : bool
        Whether times are since the epoch and not relative to the stamp.
    sector_field : str
        Name of the field with the number of the sector; empty if there is none.
    height_field : str
        Name of the field with each target's height above the world's zero, metres; empty if there
        is none. Where there is one, ranges are slant ranges.
    height : float
        Of the antenna above the world's zero, metres.
    datum : float
        Height of the world's zero, as messages count heights, metres.
    site : Site or None
        Where it stands on the round earth; None if it measures over a plane. Its heights are as
        messages count them.
    assumed_height : float
        Of targets whose height is not known, as messages count heights, metres; NaN for that of
        the antenna. Only with a site.
    code_field, address_field : str
        Names of the fields with each detection's Mode A code and Mode S address; empty if there are
        none.
    kind_field : str
        Name of the field with what saw each detection; empty if there is none.
    range_std_field, azimuth_std_field : str
        Names of the fields with each detection's own deviations, in metres and in the unit of the
        azimuth; empty if there are none.
    range_rate_field, range_rate_std_field : str
        Names of the fields with each range rate and its own deviation, metres per second; empty if
        there are none.
    range_rate_ambiguity : float
        The interval modulo which range rates are measured, metres per second; 0 for none.
    rotation_s : float
        Time of one turn of the antenna, seconds; 0 if it does not turn.
    sectors : int
        Number of clouds to a turn; 0 if a cloud is a whole turn.
    pose_topic : str
        Topic of the poses of what carries it; empty if it stands.
    pose_message : str
        ``odometry`` or ``pose_stamped``.
    pose_yaw : bool
        Whether the orientation of what carries it turns it too.
    pose_max_age_s : float
        Farthest that a detection may be from the nearest pose, seconds.
    bias : RadarBias
        What its measurements are corrected for as they are read.
    """

    name: str
    topic: str
    frame: str
    message: str = "point_cloud"
    range_field: str = "range"
    azimuth_field: str = "azimuth"
    elevation_field: str = ""
    amplitude_field: str = "amplitude"
    amplitude_in_db: bool = False
    amplitude_offset_db: float = 0.0
    compass: bool = False
    azimuth_in_degrees: bool = False
    max_range: float = math.inf
    time_field: str = ""
    time_unit_s: float = 1.0
    time_since_epoch: bool = False
    sector_field: str = ""
    height_field: str = ""
    height: float = 0.0
    datum: float = 0.0
    site: Site | None = None
    assumed_height: float = math.nan
    code_field: str = ""
    address_field: str = ""
    kind_field: str = ""
    range_std_field: str = ""
    azimuth_std_field: str = ""
    range_rate_field: str = ""
    range_rate_std_field: str = ""
    range_rate_ambiguity: float = 0.0
    rotation_s: float = 0.0
    sectors: int = 0
    pose_topic: str = ""
    pose_message: str = "odometry"
    pose_yaw: bool = True
    pose_max_age_s: float = 1.0
    bias: RadarBias = NO_BIAS
