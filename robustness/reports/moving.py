"""Faults of the poses of a radar that moves: missing, late, jumping, of another frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming import detections, moving_radars
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.types import Detections, Pose

from ..harness import scans
from ..harness.figures import Found, measures, wrong_counts
from ..harness.rig import Rig, options

TOPIC, FRAME = "/own_ship/odometry", "map"
INTERVAL_S, SCANS, WARM_UP = 2.0, 26, 8
# Number of poses per scan interval; they are not at the scans' times.
POSES = 4
# Scans without recent poses: the gap is longer than the limit of extrapolation, 1 s.
SILENT = (14, 15)
# The ship's velocity, and the target's place and velocity, m and m/s.
SHIP, PLACE, VELOCITY = np.array([6.0, 2.0]), np.array([700.0, 400.0]), np.array([-5.0, 3.0])
NEAR_M = 40.0
REPLY_S, SHORT_S = 20.0, 0.3
PARAMETERS = {
    "sensors": "[radar_1]",
    "interval_s": INTERVAL_S,
    "lag": 2,
    "classes": "[boat]",
    "motions": "[cv]",
    "births": "[]",
    "detection_births.rates": "[0.1]",
    "detection_births.std": [8.0],
    "spawn.rate": 0.0,
    "boat.motions": "[cv]",
    "boat.mode_transition": "[1.0]",
    "cv.noise_density": 0.05,
    "radar_1.fields.amplitude": "''",
    "radar_1.pose": TOPIC,
    "radar_1.position": "[0.0, 0.0]",
    "radar_1.detection_probability": 0.95,
    "radar_1.range_std": 5.0,
    "radar_1.azimuth_std_deg": 0.5,
    "radar_1.max_range": 2000.0,
    "radar_1.clutter_rate": 2.0,
    "radar_1.clutter_max_range": 2000.0,
    f"qos_overrides.{TOPIC}.subscription.reliability": "reliable",
}


@dataclass(frozen=True)
class Fault:
    """A faulty pose, sent beside the good ones."""

    counted: str  # The key in the diagnostics
    shift_s: float  # Difference of its stamp to the last good one's, seconds
    change: Callable[[Odometry], None]  # Spoils the message


def _frame(message: Odometry) -> None:
    message.header.frame_id = "odom"


def _zero_orientation(message: Odometry) -> None:
    turn = message.pose.pose.orientation
    turn.x = turn.y = turn.z = turn.w = 0.0


def _absurd(message: Odometry) -> None:
    turn = message.pose.pose.orientation
    turn.z = turn.w = 1e300


def _at(x: float) -> Callable[[Odometry], None]:
    def change(message: Odometry) -> None:
        message.pose.pose.position.x = x

    return change


def _nothing(_: Odometry) -> None:
    pass


FAULTS: Mapping[str, Fault] = {
    "of odom": Fault("dropped_frame", 0.05, _frame),
    "a position that is NaN": Fault("dropped_not_finite", 0.05, _at(math.nan)),
    "a position of infinity": Fault("dropped_not_finite", 0.05, _at(math.inf)),
    "a position of the other side of the earth": Fault("dropped_range", 0.05, _at(1e8)),
    "no orientation": Fault("dropped_orientation", 0.05, _zero_orientation),
    "an absurd orientation": Fault("dropped_orientation", 0.05, _absurd),
    "a jump of 5 km": Fault("dropped_jump", 0.05, _at(5e3)),
    "late": Fault("dropped_late", -1.3, _nothing),
    "twice": Fault("dropped_duplicate", 0.0, _nothing),
}


def _ship(time_s: float) -> Pose:
    x, y = SHIP * time_s
    return Pose((float(x), float(y)), math.atan2(SHIP[1], SHIP[0]))


def _odometry(time_s: float) -> Odometry:
    stamp_ns = scans.START_NS + round(time_s * 1e9)
    data = moving_radars.pose_to_cdr(_ship(time_s), stamp_ns, FRAME, "odometry", "own_ship")
    return interfaces.decode(data, names.ODOMETRY)


def _cloud(time_s: float, rng: np.random.Generator) -> PointCloud2:
    """Return the detection of the target, and a false one."""
    pose = _ship(time_s)
    east, north = PLACE + VELOCITY * time_s - pose.position
    seen = np.array([math.hypot(east, north), math.atan2(north, east) - pose.yaw])
    seen += rng.standard_normal(2) * [5.0, math.radians(0.5)]
    false = rng.uniform([100.0, -math.pi], [2000.0, math.pi])
    measurement = np.stack([seen, false])
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    stamp_ns = scans.START_NS + round(time_s * 1e9)
    return detections.to_msg(Detections(measurement, np.zeros(2)), stamp_ns, "radar_1")


@measures(
    "faults of a moving radar's poses",
    "0 exits, 0 NaN, every one counted, no good scan lost, the target tracked all the time",
)
def measure() -> Found:
    """Send every fault between valid poses, and leave some poses out."""
    with Rig() as rig:
        tracker, radars = rig.tracking(*options(PARAMETERS), radars=1)
        poses = radars.node.create_publisher(Odometry, TOPIC, 50)
        radars.spin_until(lambda: poses.get_subscription_count() > 0, REPLY_S)
        rng, left, lost, away = np.random.default_rng(1), dict(FAULTS), [], []
        wanted = Counter[str]()
        # The first scan must be between two poses.
        poses.publish(_odometry(-0.5 * INTERVAL_S / POSES))
        for index in range(SCANS):
            begin_s, before = index * INTERVAL_S, len(radars.filtered)
            radars.outputs[0].publish(_cloud(begin_s, rng))
            known = index not in SILENT
            for part in range(POSES):
                # The last ones before a silence are missing too: it is longer than 1 s then.
                time_s = begin_s + (part + 0.5) * INTERVAL_S / POSES
                if known and not (index + 1 in SILENT and part > 1):
                    poses.publish(_odometry(time_s))
                    if part == 0 and index > WARM_UP and left:
                        fault = left.pop(next(iter(left)))
                        message = _odometry(time_s + fault.shift_s)
                        fault.change(message)
                        poses.publish(message)
                        wanted[fault.counted] += 1
            came = radars.wait_for_more(before, REPLY_S if known else SHORT_S)
            lost += [index] if known and not came else []
            if not tracker.alive:
                raise RuntimeError(f"scan {index}: the tracker ended:\n{tracker.text[-2000:]}")
            if came and index > WARM_UP:
                away.append(radars.nearest(lambda then_s: PLACE + VELOCITY * then_s))
        counted = {**radars.values("radar_1"), **radars.values("pose of radar_1")}
        not_finite = radars.not_finite
    wanted["dropped_pose_missing"] = len(SILENT)
    found, wrong, said = wrong_counts(wanted, counted)
    tracked = float(np.mean(np.array(away) < NEAR_M))
    text = (
        f"0 exits, {not_finite} with NaN, {len(lost)} good scans lost, {len(FAULTS) + 1} faults; "
        f"{said}; the target is within {NEAR_M:g} m in {100.0 * tracked:.1f} % of the estimates"
    )
    reached = not (lost or wrong or not_finite or left) and tracked == 1.0
    return text, reached, {"counted": found, "wanted": dict(wanted), "tracked": tracked}
