"""The parameters of one radar, below its name."""

from __future__ import annotations

from phd_jdtc_ros.core.clutter.rate import START_RATE

from .schema import SMALL, Parameter

# The clutter rate of a radar that learns it.
AUTO = "auto"
# nav_msgs/Odometry and geometry_msgs/PoseStamped.
POSE_MESSAGES = ("odometry", "pose_stamped")
RADAR = (
    Parameter(
        "message",
        "point_cloud",
        "Message type of its topic. point_cloud: sensor_msgs/PointCloud2; radar_scan: "
        "radar_msgs/RadarScan, whose definition fixes fields, units and conventions.",
        choices=("point_cloud", "radar_scan"),
    ),
    Parameter("topic", "", "Topic of its detections; /NAME/detections if empty."),
    Parameter("frame", "", "frame_id of its clouds; the radar's name if empty."),
    Parameter(
        "position", [0.0, 0.0], "Position of the radar in the world frame, x and y, m.", length=2
    ),
    Parameter(
        "geodetic",
        [],
        "Latitude and longitude of the radar, degrees (WGS84), and height of its antenna, m, "
        "instead of position and height; needs world_origin. Its ranges are then slant ranges over "
        "the round earth, and its azimuths are from true north. Empty: position says where it is.",
        -1e4,
        1e4,
    ),
    Parameter(
        "yaw_deg",
        0.0,
        "Direction of the radar's x axis in the world frame, counter-clockwise from x, degrees; "
        "with geodetic from true east.",
        -360.0,
        360.0,
    ),
    Parameter(
        "pose",
        "fixed",
        "Where the radar is. fixed: at position and yaw_deg; a topic: on a platform whose poses in "
        "the world frame come there, at position and yaw_deg in the platform's frame.",
    ),
    Parameter(
        "pose_message",
        "odometry",
        "Message type of the poses' topic. odometry: nav_msgs/Odometry; pose_stamped: "
        "geometry_msgs/PoseStamped.",
        choices=POSE_MESSAGES,
    ),
    Parameter(
        "pose_yaw",
        True,
        "Whether the platform's orientation turns the radar; false for azimuths that are "
        "stabilised, as to north.",
    ),
    Parameter(
        "pose_max_age_s",
        1.0,
        "Farthest that a detection may be from the nearest pose, s: so long a platform is "
        "extrapolated with its last velocity, and detections wait for poses.",
        0.0,
        60.0,
    ),
    Parameter(
        "pose_max_speed",
        100.0,
        "Speed above which a change between two poses is a jump, m/s; such poses are not used.",
        SMALL,
        1e5,
    ),
    Parameter("range_std", 300.0, "Standard deviation of the range, m.", SMALL, mutable=True),
    Parameter(
        "azimuth_std_deg",
        1.0,
        "Standard deviation of the azimuth, degrees.",
        SMALL,
        180.0,
        mutable=True,
    ),
    Parameter(
        "range_step",
        0.0,
        "Step to which the radar rounds ranges, m; adds to the standard deviation.",
        0.0,
        mutable=True,
    ),
    Parameter(
        "azimuth_step_deg",
        0.0,
        "Step to which the radar rounds azimuths, degrees; adds to the standard deviation.",
        0.0,
        180.0,
        mutable=True,
    ),
    Parameter(
        "range_std_growth",
        0.0,
        "What the standard deviation of the range grows by with the range, m per m; the two are "
        "added as squares.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter(
        "max_range", 17e3, "Range beyond which targets and detections are ignored, m.", SMALL
    ),
    Parameter(
        "min_range", 0.0, "Range below which targets are not detected, m.", 0.0, mutable=True
    ),
    Parameter(
        "fov_deg",
        [0.0, 360.0],
        "Field of view: from this azimuth to that one, in the direction in which the radar counts "
        "azimuths, degrees.",
        -360.0,
        720.0,
        length=2,
    ),
    Parameter(
        "blind_sectors_deg",
        [],
        "Hidden azimuths in the field of view, from and to, from and to, and so on, counted as in "
        "fov_deg; empty for none.",
        -360.0,
        720.0,
    ),
    Parameter(
        "detection_probability",
        0.0,
        "Probability to detect a target in a scan or a turn; 0: it follows from the classes' SNR "
        "bands and false_alarm_probability.",
        0.0,
        0.999,
        mutable=True,
    ),
    Parameter(
        "detection_probability_over_range",
        [],
        "The same as a table: range (m) and probability, range and probability, and so on, with "
        "rising ranges; linear in between. Empty for none.",
        0.0,
    ),
    Parameter(
        "rotation_s",
        0.0,
        "First guess of the time of one turn of the antenna, s; 0 for one that does not turn, or "
        "of which that is found out.",
        0.0,
        1e3,
    ),
    Parameter(
        "sectors",
        0,
        "Number of clouds that the radar publishes in a turn; 0 if a cloud is a whole turn, or "
        "detections have times of their own.",
        0,
        256,
    ),
    Parameter(
        "cluster_distance",
        0.0,
        "Distance within which detections of one scan, with range rates that agree, count as one, "
        "m; for radars that see a vehicle as several points. 0 for none.",
        0.0,
        1e4,
        mutable=True,
    ),
    Parameter(
        "clutter_rate",
        START_RATE,
        "Expected false detections per scan, or per turn; with clutter_map those that come from "
        "nowhere in particular. auto: the tracker learns it from what no target claims, some 30 "
        f"scans back; it begins with {START_RATE:g}.",
        0.0,
        1e6,
        words=(AUTO,),
        mutable=True,
    ),
    Parameter(
        "clutter_max_range",
        15e3,
        "Range up to which false detections are uniform in range and azimuth, m.",
        SMALL,
        mutable=True,
    ),
    Parameter(
        "clutter_map",
        False,
        "Learn where false detections come from: a map of the radar's range and azimuth, so that "
        "what answers at the same place turn after turn does not become a target. Of a radar that "
        "moves it is a map of the world, with engine gaussian only.",
    ),
    Parameter(
        "clutter_map_speed",
        2.5,
        "Targets that are probably slower than this are not reported, and their detections count "
        "as clutter in the map, m/s; 0: those at rest stay targets, once they are.",
        0.0,
        1e3,
        mutable=True,
    ),
    Parameter(
        "clutter_amplitude",
        "rayleigh",
        "Law of the amplitudes of false detections. rayleigh: that of noise, or clutter_level_db "
        "above it; log_normal: of median clutter_level_db and standard deviation clutter_std_db; "
        "learned: as what no target claims tells it.",
        choices=("rayleigh", "log_normal", "learned"),
    ),
    Parameter(
        "clutter_level_db",
        0.0,
        "Level of clutter as an SNR, dB; 0 is noise. Not used if its law is learned.",
        -100.0,
        200.0,
        mutable=True,
    ),
    Parameter(
        "clutter_std_db",
        6.0,
        "Standard deviation of the level of log-normal clutter, dB.",
        0.1,
        100.0,
        mutable=True,
    ),
    Parameter(
        "false_alarm_probability",
        1e-3,
        "Probability that noise exceeds the detection threshold; determines the threshold.",
        1e-30,
        0.999,
        mutable=True,
    ),
    Parameter("fields.range", "range", "Name of the cloud's range field."),
    Parameter("fields.azimuth", "azimuth", "Name of the cloud's azimuth field."),
    Parameter(
        "fields.elevation",
        "",
        "Name of the cloud's elevation field if its ranges are slant ranges; empty if they are "
        "ground ranges.",
    ),
    Parameter(
        "fields.amplitude",
        "amplitude",
        "Name of the cloud's amplitude field; empty if it has none.",
    ),
    Parameter(
        "fields.time",
        "",
        "Name of the cloud's field with the time of each detection; empty if it has none and all "
        "are at the stamp.",
    ),
    Parameter("time_unit", "s", "Unit of the detections' times.", choices=("s", "ms", "us", "ns")),
    Parameter(
        "time_reference",
        "stamp",
        "stamp: the detections' times are relative to the cloud's stamp; epoch: they count from "
        "the zero of the stamps.",
        choices=("stamp", "epoch"),
    ),
    Parameter(
        "fields.sector",
        "",
        "Name of the cloud's field with the number of the sector, from 0; empty if it has none.",
    ),
    Parameter(
        "fields.height",
        "",
        "Name of the cloud's field with each target's height above the world's zero, m; its ranges "
        "are then slant ranges. Empty if it has none.",
    ),
    Parameter(
        "fields.code",
        "",
        "Name of the cloud's field with each detection's Mode A code, a whole number of 12 bits "
        "(4032 is 7700 in octal digits), 4294967295 if it is unknown; empty if it has none.",
    ),
    Parameter(
        "fields.address",
        "",
        "Name of the cloud's field with each detection's Mode S address, a whole number of 24 "
        "bits, 0 or 4294967295 if it is unknown; empty if it has none.",
    ),
    Parameter(
        "fields.kind",
        "",
        "Name of the cloud's field with what saw each detection, the TYP of I048/020: 1 primary, 2 "
        "secondary, 3 both, 4 and 5 Mode S, 6 and 7 Mode S and primary. The estimates then have "
        "the times since each kind of sensor saw their targets. Empty if it has none.",
    ),
    Parameter("height", 0.0, "Height of the antenna above the world's zero, m.", -1e4, 1e5),
    Parameter(
        "assumed_height",
        [],
        "Height of targets whose height is not known, m, counted as those of world_origin; only "
        "with geodetic. Empty: that of the antenna.",
        -1e4,
        1e5,
    ),
    Parameter(
        "fields.range_std",
        "",
        "Name of the cloud's field with the standard deviation of each range, m; empty if it has "
        "none.",
    ),
    Parameter(
        "fields.azimuth_std",
        "",
        "Name of the cloud's field with the standard deviation of each azimuth, in the azimuth's "
        "unit; empty if it has none.",
    ),
    Parameter(
        "fields.range_rate",
        "",
        "Name of the cloud's field with the range rate of each detection relative to the radar, "
        "m/s, positive where a target recedes; empty if it has none, or not to use it. With "
        "radar_scan any name: use its doppler_velocity.",
    ),
    Parameter(
        "range_rate_std",
        0.1,
        "Standard deviation of the range rate, m/s.",
        1e-3,
        1e3,
        mutable=True,
    ),
    Parameter(
        "range_rate_ambiguity",
        0.0,
        "Interval modulo which the radar measures range rates, m/s; 0 if they are not ambiguous.",
        0.0,
        1e4,
        mutable=True,
    ),
    Parameter(
        "range_rate_span",
        200.0,
        "Width of the interval about zero in which false detections have range rates, m/s; with an "
        "ambiguity it is that.",
        1e-3,
        1e4,
        mutable=True,
    ),
    Parameter(
        "fields.range_rate_std",
        "",
        "Name of the cloud's field with the standard deviation of each range rate, m/s; empty if "
        "it has none.",
    ),
    Parameter(
        "amplitude_unit",
        "linear",
        "linear: an envelope in units of the noise's standard deviation per quadrature; db: SNR.",
        choices=("linear", "db"),
    ),
    Parameter(
        "amplitude_offset_db", 0.0, "Added to every amplitude, dB.", -300.0, 300.0, mutable=True
    ),
    Parameter(
        "azimuth_convention",
        "enu_ccw",
        "enu_ccw: from the sensor's x axis, counter-clockwise; compass_cw: from north, clockwise.",
        choices=("enu_ccw", "compass_cw"),
    ),
    Parameter("azimuth_unit", "rad", "Unit of the azimuth: rad or deg.", choices=("rad", "deg")),
    Parameter(
        "range_bias",
        0.0,
        "What its ranges are too long by, m; it is subtracted as they are read. register finds it, "
        "and the next three.",
        -1e5,
        1e5,
    ),
    Parameter(
        "range_gain",
        0.0,
        "What its ranges are too long by in addition, m per m of range.",
        -0.5,
        0.5,
    ),
    Parameter(
        "azimuth_bias_deg",
        0.0,
        "What its azimuths are too large by, in the direction in which it counts them, degrees.",
        -180.0,
        180.0,
    ),
    Parameter(
        "time_offset_s",
        0.0,
        "What its stamps and its detections' times are late by, s; negative if they are early.",
        -60.0,
        60.0,
    ),
)
