# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of parameters: names, defaults, units and bounds.

Parameters are flat dotted names with plain values, as in ROS. Four lists name the parts (`radars`,
`classes`, `motions`, `births`), and every name in them has its own parameters, such as
``radar_1.range_std``. The defaults are the reference scenario. Units are SI unless a suffix names
another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ..models.clutter_count import START_RATE
from ..models.motion import MOTIONS
from ..smc.correction import CORRECTORS
from ..smc.extraction import EXTRACTIONS
from ..smc.smoother import DEATH_TERMS
from .schema import SMALL, Parameter, Value

# The clutter rate of a radar that learns it.
AUTO = "auto"
TOP = (
    Parameter("world_frame", "map", "Frame of the estimates (ENU, metres)."),
    Parameter(
        "world_origin",
        [],
        "Latitude and longitude, degrees (WGS84), of the world frame's zero, and the height, m, of "
        "its z = 0; x and y are then in the stereographic plane about it. Empty: the world is a "
        "plane anywhere.",
        -1e4,
        1e4,
    ),
    Parameter(
        "radars",
        ["radar_1", "radar_2"],
        "Names of the radars, in the order of updates.",
        element=str,
    ),
    Parameter("classes", ["class_0", "class_1"], "Names of the target classes.", element=str),
    Parameter("motions", ["cv", "ct"], "Names of the motion models.", element=str),
    Parameter(
        "births",
        ["start_1", "start_2", "start_3", "start_4"],
        "Names of the birth terms.",
        element=str,
    ),
    Parameter(
        "interval_s",
        6.0,
        "Nominal interval, s: the one that rates, probabilities and mode matrices are given for; "
        "they are converted to the true interval.",
        1e-3,
        1e4,
    ),
    Parameter(
        "fixed_interval",
        False,
        "Convert mode matrices in whole nominal intervals only, so that they need no rate matrix.",
    ),
    Parameter(
        "max_gap_scans",
        15.0,
        "Longest gap between scans that is predicted over, in intervals, or in turns where they "
        "are longer; after a longer one a new run begins.",
        2.0,
        1e6,
    ),
    Parameter(
        "reorder_scans",
        0,
        "Number of scans held back to put stamps in order that arrive out of order; estimates come "
        "this many scans later.",
        0,
        2,
    ),
    Parameter(
        "reorder_s",
        0.0,
        "Longest time that detections are held back for those of other radars that are as old, s; "
        "0 for none. For radars that report whole turns and are not synchronous: their rotation_s.",
        0.0,
        1e3,
    ),
    Parameter(
        "late_reports",
        "drop",
        "What becomes of reports of closed scans. drop: they are dropped and counted; rework: as "
        "long as smoothed estimates of their time are to come, the scans since are stepped again "
        "with them.",
        choices=("drop", "rework"),
    ),
    Parameter(
        "region",
        [],
        "What the tracker is for where several part an area: [x_min, y_min, x_max, y_max] in the "
        "world frame, m. What is farther from it than region_margin is neither taken in nor "
        "reported. Empty for everything.",
        -1e6,
        1e6,
    ),
    Parameter(
        "region_margin",
        0.0,
        "How far a tracker's region extends beyond region on each side, m: the overlap with its "
        "neighbours, in which tracks are handed over.",
        0.0,
        1e6,
    ),
    Parameter(
        "estimates_period_s",
        0.0,
        "Time between estimates, s: all targets are predicted to one stamp. 0: estimates with "
        "every scan, at its stamp.",
        0.0,
        1e4,
    ),
    Parameter(
        "engine",
        "particles",
        "What represents a target. particles: weighted samples; gaussian: a mixture of Gaussians, "
        "one per association hypothesis and motion.",
        choices=("particles", "gaussian"),
    ),
    Parameter(
        "hypotheses_per_target",
        8,
        "Largest number of association hypotheses of a target, with engine gaussian.",
        1,
        1000,
    ),
    Parameter(
        "least_hypothesis",
        1e-4,
        "Probability, given that the target exists, below which one of its hypotheses is dropped; "
        "with engine gaussian.",
        0.0,
        0.5,
    ),
    Parameter(
        "merge_distance",
        4.0,
        "Square Mahalanobis distance within which a target's hypotheses are merged, with engine "
        "gaussian.",
        0.0,
        100.0,
    ),
    Parameter(
        "max_hypotheses",
        50_000,
        "Largest number of hypotheses of all targets; beyond it the least probable targets are "
        "dropped. With engine gaussian.",
        100,
        10**7,
    ),
    Parameter("lag", 5, "Smoothing lag, scans.", 0, 100),
    Parameter("lag_s", 0.0, "Smoothing lag, s; above 0 it replaces lag.", 0.0, 1e5),
    Parameter(
        "corrector",
        "bernoulli",
        "How detections correct the intensity. bernoulli: every origin is at most one target, and "
        "its label; poisson: the Poisson process of the PHD filter, as in the paper.",
        choices=tuple(CORRECTORS),
    ),
    Parameter(
        "death_term",
        "bernoulli",
        "Backward death term. bernoulli: every component is at most one target; paper: as printed.",
        choices=tuple(DEATH_TERMS),
    ),
    Parameter(
        "extraction",
        "components",
        "How targets are extracted. components: one per component; clusters: by clustering, as in "
        "the paper.",
        choices=tuple(EXTRACTIONS),
    ),
    Parameter(
        "confirm_probability",
        0.0,
        "Existence probability above which a track is confirmed, and reported from then on; 0: it "
        "follows from the classes' detection probabilities. With corrector poisson, which has no "
        "tracks, the one above which a target is reported; 0: 0.5.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter(
        "delete_probability",
        0.0,
        "Existence probability below which a confirmed track is no longer reported; 0: it "
        "follows from the classes' detection probabilities, and from how often the track was "
        "missed before. Not used with corrector poisson.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter(
        "coasting_scans",
        10.0,
        "Intervals, or turns where they are longer, for which a track is reported after its last "
        "detection where no radar can see it: beyond their ranges or in blind sectors. It has its "
        "number again when it is detected later. Not used with corrector poisson.",
        0.0,
        1e6,
        mutable=True,
    ),
    Parameter(
        "amplitude",
        "band",
        "Use of amplitudes. band: they tell the class by its SNR band; memory: every target's own "
        "SNR is estimated too; none: they are ignored.",
        choices=("band", "memory", "none"),
    ),
    Parameter(
        "amplitude_jitter", 0.1, "Random step of ln(1 + SNR) per interval, with memory.", 0.0, 10.0
    ),
    Parameter("seed", 0, "Seed of the random generator.", 0, 2**31 - 1),
    Parameter("particles_per_target", 1500, "Particles per target after resampling.", 10, 10**6),
    Parameter("least_particles", 200, "Least number of particles per origin and class.", 1, 10**5),
    Parameter("particles_per_birth", 2048, "Particles per birth term; a power of two.", 2, 2**20),
    Parameter(
        "max_particles",
        200_000,
        "Largest total number of particles; if it would be exceeded, every origin gets fewer.",
        1000,
        10**8,
    ),
    Parameter(
        "detection_births.rates",
        [],
        "Expected births anywhere in a radar's field per interval, one number per class; such "
        "targets are born at detections. Empty for none.",
        0.0,
        1e3,
    ),
    Parameter(
        "detection_births.velocity_std",
        40.0,
        "Standard deviation of a newborn target's velocity about zero along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "detection_births.turn_rate_std",
        1e-3,
        "Standard deviation of a newborn target's turn rate about zero, rad/s.",
        SMALL,
    ),
    Parameter(
        "detection_births.particles", 1024, "Particles per detection; a power of two.", 2, 2**16
    ),
    Parameter(
        "detection_births.least_probability",
        1e-4,
        "Probability of being a new target below which a detection gets no particles; a larger one "
        "lets fewer targets begin beside established ones.",
        1e-12,
        0.5,
    ),
    Parameter(
        "equipped_probability",
        0.9,
        "Probability that a target has a transponder, where a radar reports codes or addresses.",
        0.001,
        0.999,
        mutable=True,
    ),
    Parameter(
        "reply_probability",
        0.95,
        "Probability that a detection of such a target has an answer.",
        0.01,
        0.999,
        mutable=True,
    ),
    Parameter(
        "code_garbled",
        0.01,
        "Probability that a code or an address is garbled and may be any.",
        1e-6,
        0.5,
        mutable=True,
    ),
    Parameter(
        "shared_codes",
        ["0000", "1000", "2000", "7000", "7500", "7600", "7700", "7777"],
        "Codes that many targets have: four octal digits each.",
        element=str,
        mutable=True,
    ),
    Parameter(
        "shared_code_probability",
        0.2,
        "Probability that a target has one of the shared codes.",
        0.0,
        0.99,
        mutable=True,
    ),
    Parameter(
        "code_kept_s",
        1800.0,
        "Mean time until a target gets another code, s.",
        1.0,
        1e9,
        mutable=True,
    ),
    Parameter(
        "clutter_reply_probability",
        0.05,
        "Probability that a false detection has a code or an address.",
        0.001,
        0.999,
        mutable=True,
    ),
    Parameter(
        "height_std",
        7.6,
        "Standard deviation of a detection's height, m; 7.6 is that of steps of 100 ft.",
        1e-3,
        1e4,
        mutable=True,
    ),
    Parameter(
        "height_noise_density",
        1.0,
        "Spectral density of the white vertical acceleration, m^2/s^3.",
        SMALL,
        1e6,
        mutable=True,
    ),
    Parameter(
        "height_climb_std",
        10.0,
        "Standard deviation of a new target's climb rate about zero, m/s.",
        SMALL,
        1e3,
        mutable=True,
    ),
    Parameter(
        "height_garbled",
        0.01,
        "Probability that a height is garbled and may be any.",
        1e-6,
        0.5,
        mutable=True,
    ),
    Parameter(
        "height_evidence",
        1.0,
        "What heights count in the association, as the exponent of their likelihood: 1 as they "
        "are, 0 not at all.",
        0.0,
        1.0,
        mutable=True,
    ),
    Parameter("spawn.rate", 0.01, "Expected spawned targets per target and interval.", 0.0, 1.0),
    Parameter(
        "spawn.position_std",
        10.0,
        "Standard deviation of a spawned position about its parent's along each axis, m.",
        SMALL,
    ),
    Parameter(
        "spawn.velocity_std",
        1.0,
        "Standard deviation of a spawned velocity about its parent's along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "spawn.turn_rate_std",
        1e-4,
        "Standard deviation of a spawned turn rate about its parent's, rad/s.",
        SMALL,
    ),
    Parameter(
        "spawn.particles_per_target",
        100,
        "Particles for the targets that one target spawns.",
        1,
        10**5,
    ),
    Parameter(
        "spawn.class_transition",
        [0.5, 0.5, 0.5, 0.5],
        "Probabilities [class of the parent, class of the spawned target], row by row; empty for "
        "uniform.",
        0.0,
        1.0,
    ),
    Parameter(
        "spawn.mode_transition",
        [0.9, 0.1, 0.1, 0.9],
        "Probabilities [motion of the parent, motion of the spawned target], row by row; empty for "
        "uniform.",
        0.0,
        1.0,
    ),
)
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
        choices=("odometry", "pose_stamped"),
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
        "Time of one turn of the antenna, s; 0 for one that does not turn.",
        0.0,
        1e3,
    ),
    Parameter(
        "sectors",
        0,
        "Number of clouds that the radar publishes in a turn; 0 if a cloud is a whole turn.",
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
        "Expected false detections per scan, or per turn. auto: the tracker learns it from what no "
        f"target claims, some 30 scans back; it begins with {START_RATE:g}.",
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
CLASS = (
    Parameter(
        "snr_band_db", [10.0, 50.0], "Lowest and highest mean SNR, dB.", -100.0, 200.0, length=2
    ),
    Parameter("motions", ["cv", "ct"], "Motion models of the class.", element=str),
    Parameter(
        "mode_transition",
        [0.95, 0.05, 0.1, 0.9],
        "Probabilities [motion, motion one interval later], row by row.",
        0.0,
        1.0,
    ),
    Parameter("survival_probability", 0.99, "Probability to survive an interval.", SMALL, 1.0),
)
MOTION = (
    Parameter(
        "model",
        "constant_velocity",
        "constant_velocity: nearly straight on; coordinated_turn: with its own turn rate.",
        choices=tuple(MOTIONS),
    ),
    Parameter("noise_density", 1.0, "Spectral density of the white acceleration, m^2/s^3.", SMALL),
    Parameter(
        "turn_noise_density",
        1e-4,
        "Spectral density of the white turn acceleration, rad^2/s^3; coordinated_turn only.",
        1e-15,
    ),
)
BIRTH = (
    Parameter(
        "position",
        [0.0, 0.0],
        "Mean position of a newborn target in the world frame, x and y, m.",
        length=2,
    ),
    Parameter(
        "velocity",
        [0.0, 0.0],
        "Mean velocity of a newborn target in the world frame, x and y, m/s.",
        length=2,
    ),
    Parameter(
        "position_std",
        200.0,
        "Standard deviation of a newborn target's position along each axis, m.",
        SMALL,
    ),
    Parameter(
        "velocity_std",
        40.0,
        "Standard deviation of a newborn target's velocity along each axis, m/s.",
        SMALL,
    ),
    Parameter(
        "turn_rate_std",
        1e-3,
        "Standard deviation of a newborn target's turn rate about zero, rad/s.",
        SMALL,
    ),
    Parameter(
        "rates",
        [0.005, 0.005],
        "Expected births per interval, one number per class.",
        0.0,
        1e3,
        mutable=True,
    ),
)
# Parameters of earlier versions, and those that have taken their place.
REPLACED = {"existence_threshold": "confirm_probability and delete_probability"}
GROUPS: dict[str, tuple[Parameter, ...]] = {
    "radars": RADAR,
    "classes": CLASS,
    "motions": MOTION,
    "births": BIRTH,
}
# Values of the reference scenario that differ from the defaults of their group.
REFERENCE: dict[str, Value] = {
    "radar_1.position": [1000.0, 0.0],
    "class_0.snr_band_db": [30.0, 50.0],
    "class_1.snr_band_db": [10.0, 30.0],
    # With the mode matrices and the noise of turns, found on seeds from 9000 on of the reference
    # scenario and of targets that turn; config/paper_scenario.yaml has the paper's.
    "cv.noise_density": 0.2,
    "ct.model": "coordinated_turn",
    "start_1.position": [-10e3, 10e3],
    "start_2.position": [-10e3, -10e3],
    "start_3.position": [-10e3, -10.5e3],
    "start_4.position": [1.4e3, 8e3],
}


def schema(given: Mapping[str, Any]) -> dict[str, Parameter]:
    """Return all parameters for the lists of names in `given`, by dotted name.

    Faulty lists are replaced by their defaults; `resolve` reports them.
    """
    table = {parameter.name: parameter for parameter in TOP}
    for group, members in GROUPS.items():
        names = table[group].coerce(given.get(group, table[group].default))
        if names is None:
            names = table[group].default
        for name in names if isinstance(names, list) else []:
            for member in members:
                full = f"{name}.{member.name}"
                default = REFERENCE.get(full, member.default)
                table[full] = replace(member, name=full, default=default)
    return table
