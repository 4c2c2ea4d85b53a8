"""Absurd finite numbers in every numeric field of every input message.

The square of 1e300 is an error in Python and infinite in NumPy. Neither may end a node or be
published; the same holds for impossible stamps.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud
from msg_adapters.incoming import moving_radars
from msg_adapters.incoming.readers import reader_of
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros.asterix.messages import CallSigns
from phd_jdtc_ros.asterix.writing import Source
from phd_jdtc_ros.asterix_bridge.tracks import TrackOutput
from phd_jdtc_ros.columns.position_selection import AREA
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.posed_reports import Platform
from phd_jdtc_ros.core.intake.poses import Mount, PoseTrack
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Event, Pipeline, Stepped
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import SENSORS, SOURCES, Attributes, Detections, Estimates, Pose, Truth
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.handover import picture
from phd_jdtc_ros.handover.picture import JointPicture
from phd_jdtc_ros.parameter_files import from_arguments

from ..harness import scans
from ..harness.figures import Found, measures, such_as

NS, START_NS = scans.SECOND_NS, scans.START_NS
VALUES = (1e300, -1e300, 1.7e308, 1e160, 1e154, 3.4e38, 1e20, -1e9, 1e-40, 5e-324)
WHOLE = (0, 2**31 - 1, 2**31, 2**32 - 1)
SECONDS, NANOSECONDS = (-(2**31), -1, 0, 2**31 - 1), (0, NS, 2**32 - 1)
PROFILE = scans.CONFIG / "air_traffic.yaml"
INTERVAL_S = 4.0
# The fields of a radar with all optional fields.
FIELDS = (
    *("time", "height", "code", "address", "detection_type"),
    *("range_std", "azimuth_std", "range_rate", "range_rate_std"),
)
REGIONS = (Region(-1e5, -1e5, 0.0, 1e5, 1e4), Region(0.0, -1e5, 1e5, 1e5, 1e4))
_CODES = {PointField.FLOAT32: "f8", PointField.FLOAT64: "f8", PointField.UINT32: "u4"}


GOAL = "in every numeric field: 0 errors, 0 NaN"
# A description of a message, and the function that processes it.
Case = tuple[str, Callable[[], None]]


@measures("absurd finite numbers in a radar's clouds", GOAL)
def measure_radar(every: int = 1, **given: Any) -> Found:
    """Process every spoilt cloud of a radar, or some, as a tracker with some parameters does."""
    return _outcomes(_of_radars(every, given))


@measures("absurd finite numbers in clouds of sensors in space", GOAL)
def measure_in_space(every: int = 1) -> Found:
    """Process every spoilt cloud of a radar with elevations and of a sensor of positions."""
    return _outcomes(chain.from_iterable(_in_space(index, every) for index in range(len(IN_SPACE))))


@measures("absurd finite numbers in other messages", GOAL)
def measure(every: int = 1) -> Found:
    """Process every spoilt pose, and spoilt clouds of estimates or truth, as a node does."""
    return _outcomes(chain(_of_poses(), _of_clouds(every)))


def _outcomes(cases: Iterator[Case]) -> Found:
    faults = {what: outcome(use) for what, use in cases}
    wrong = {what: fault for what, fault in faults.items() if fault}
    text = f"{len(faults):,} messages: {len(wrong)} end with an error or NaN{such_as(wrong)}"
    return text, not wrong, {"messages": len(faults), "wrong": wrong}


def outcome(use: Callable[[], None]) -> str:
    """Return the fault in the processing of a message; empty without one."""
    try:
        with np.errstate(all="ignore"):
            use()
    except RejectedMessageError:
        pass
    except Exception as error:  # Any of them would end a node
        return f"{type(error).__name__}: {error}"[:200]
    return ""


def _of_clouds(every: int) -> Iterator[Case]:
    """Yield clouds of estimates at each node that takes them, and clouds of truth."""
    clouds = ((_hand_over, "hand_over"), (_to_asterix, "asterix"), (_evaluate, "evaluator"))
    for use, name in clouds:
        for what, make in spoil(estimates.to_msg(_estimates(START_NS), "map"))[::every]:
            yield f"estimates to {name}: {what}", partial(_use, use, make)
    for what, make in spoil(truth.to_msg(_truth(START_NS), "map"))[::every]:
        yield f"truth: {what}", partial(_use, _evaluate_truth, make)


def _use(use: Callable[[PointCloud2], None], make: Callable[[], PointCloud2]) -> None:
    use(make())


def spoil(cloud: PointCloud2) -> list[tuple[str, Callable[[], PointCloud2]]]:
    """Return a cloud with each value in each field of its first point, and with each stamp.

    It is made by a function, which is described.
    """
    found: list[tuple[str, Callable[[], PointCloud2]]] = []
    codes = [_CODES.get(field.datatype, "u1") for field in cloud.fields]
    wanted = {field.name: [*point_cloud.FLOATS, "u4", "u1"] for field in cloud.fields}
    columns = point_cloud.decode(cloud, wanted)
    for (name, column), code in zip(columns.items(), codes, strict=True):
        for value in VALUES if code == "f8" else WHOLE:
            if code == "u1":
                continue
            changed = column.astype(code)
            changed[0] = value
            make = partial(_cloud, cloud, {**columns, name: changed}, name)
            found.append((f"{name} {value:g}", make))
    found += [
        (f"stamp {sec} s {nanosec} ns", partial(_stamped, cloud, sec, nanosec))
        for sec, nanosec in product(SECONDS, NANOSECONDS)
    ]
    return found


def _stamped(cloud: PointCloud2, sec: int, nanosec: int) -> PointCloud2:
    stamped = interfaces.decode(interfaces.encode(cloud), names.CLOUD)
    stamped.header.stamp.sec, stamped.header.stamp.nanosec = sec, nanosec
    return stamped


def _cloud(cloud: PointCloud2, columns: Mapping[str, Any], wide: str) -> PointCloud2:
    found = point_cloud.encode(START_NS, cloud.header.frame_id, columns, {wide})
    found.header = cloud.header
    return found


def _of_poses() -> Iterator[Case]:
    """Yield poses of every kind with each value in each numeric field of position and direction."""
    for kind, type_name in moving_radars.POSE_TYPES.items():
        data = moving_radars.pose_to_cdr(Pose((1.0, 2.0), 0.3), START_NS, "map", kind)
        axes = *product(["position"], "xyz"), *product(["orientation"], "xyzw")
        for (part, axis), value in product(axes, VALUES):
            message = interfaces.decode(data, type_name)
            pose = message.pose.pose if kind == "odometry" else message.pose
            setattr(getattr(pose, part), axis, value)
            yield f"{kind}: {part}.{axis} {value:g}", partial(_carry, message)
        for sec, nanosec in product(SECONDS, NANOSECONDS):
            message = interfaces.decode(data, type_name)
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
            yield f"{kind}: stamp {sec} s {nanosec} ns", partial(_carry, message)


def _carry(message: Any) -> None:
    """Place a radar's detections by a pose."""
    stamp_ns, pose = moving_radars.pose_from_msg(message, "map")
    track = PoseTrack(max_speed=1e6)
    track.add(stamp_ns - NS, Pose((0.0, 0.0), 0.0))
    track.add(stamp_ns, pose)
    seen = Detections(np.array([[100.0, 0.1]]), None, np.array([0.01]))
    placed, _ = Platform(track, Mount((1.0, 1.0), 0.1)).with_pose(stamp_ns, seen)
    if placed is not None:
        _require_finite(placed.measurement)


def _require_finite(*arrays: Any) -> None:
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("a number that is not finite goes out")


def _of_radars(every: int, given: Mapping[str, Any]) -> Iterator[Case]:
    """Yield clouds of a radar with all optional fields, in one run of the tracker."""
    values = from_arguments.load(PROFILE)
    values |= {f"approach.fields.{name}": name for name in FIELDS}
    values |= {
        "approach.range_rate_std": 2.0,
        "lag_s": INTERVAL_S,
        **given,
    }
    return _of_sensor(from_arguments.config_of(values), 0, _plots, every)


def _of_sensor(
    config: TrackerConfig,
    sensor: int,
    columns_of: Callable[[np.random.Generator], Mapping[str, FloatArray]],
    every: int,
) -> Iterator[Case]:
    """Yield clouds of a sensor, of which only the first point is spoilt, in one run."""
    pipeline, rng = new_pipeline(config), np.random.default_rng(0)
    own, scan = config.inputs[sensor], 0

    def use(cloud: PointCloud2) -> None:
        report = reader_of(own).from_msg(cloud, own)
        _step(pipeline, pipeline.add(sensor, report.stamp_ns, report.detections, report.sector))

    def plots() -> PointCloud2:
        nonlocal scan
        scan += 1
        columns = columns_of(rng)
        stamp_ns = START_NS + round(scan * INTERVAL_S * NS)
        return point_cloud.encode(stamp_ns, own.frame, columns, set(columns))

    for _ in range(3):
        yield f"{own.name}: as usual", partial(use, plots())
    # Absurd stamps come last, because they end the run.
    for index in range(0, len(spoil(plots())), every):
        what, make = spoil(plots())[index]
        yield f"{own.name}: {what}", partial(_use, use, make)
    yield f"{own.name}: the end", lambda: _step(pipeline, pipeline.flush())


def _in_space(sensor: int, every: int) -> Iterator[Case]:
    """Yield clouds of one of the sensors in space, with all their fields."""
    config = resolve(
        {
            "state": "space",
            "sensors": [*IN_SPACE],
            "interval_s": INTERVAL_S,
            "lag_s": INTERVAL_S,
            "dome.fields.elevation": "elevation",
            "dome.fields.elevation_std": "elevation_std",
            "dome.fields.range_rate": "range_rate",
            "dome.fields.height": "height",
            "dome.fields.amplitude": "",
            "dome.detection_probability": 0.9,
            "lidar.kind": "position",
            "lidar.area": [-3e4, -3e4, 3e4, 3e4],
            "lidar.fields.velocity_std": "velocity_std",
        }
    )
    return _of_sensor(config, sensor, [*IN_SPACE.values()][sensor], every)


def _domes_plots(rng: np.random.Generator) -> dict[str, FloatArray]:
    count = 6
    return {
        "range": rng.uniform(5e3, 2e4, count),
        "azimuth": rng.uniform(0.0, 2.0 * np.pi, count),
        "elevation": rng.uniform(0.0, 1.0, count),
        "elevation_std": np.full(count, 0.02),
        "range_rate": rng.uniform(-50.0, 50.0, count),
        "height": rng.uniform(0.0, 3e3, count),
    }


def _lidars_plots(rng: np.random.Generator) -> dict[str, FloatArray]:
    count = 6
    found = {name: rng.uniform(-2e4, 2e4, count) for name in "xyz"}
    found |= {name: rng.uniform(-20.0, 20.0, count) for name in ("vx", "vy", "vz")}
    found |= {name: np.full(count, 5.0) for name in ("x_std", "y_std", "z_std", "velocity_std")}
    found["correlation"] = rng.uniform(-0.9, 0.9, count)
    edges = zip(AREA, (-3e4, -3e4, 3e4, 3e4), strict=True)
    return {**found, **{name: np.full(count, edge) for name, edge in edges}}


# Sensors in space, and the columns of their clouds.
IN_SPACE = {"dome": _domes_plots, "lidar": _lidars_plots}


def _plots(rng: np.random.Generator) -> dict[str, FloatArray]:
    """Return the plots of a revolution."""
    count = 6
    azimuth = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    return {
        "range": rng.uniform(5e3, 5e4, count),
        "azimuth": azimuth,
        "time": INTERVAL_S * (azimuth / (2.0 * np.pi) - 1.0),
        "height": rng.uniform(0.0, 3e3, count),
        "code": rng.uniform(0.0, 4096.0, count).round(),
        "address": rng.uniform(1.0, 9999.0, count).round(),
        "detection_type": np.full(count, 3.0),
        "range_std": np.full(count, 30.0),
        "azimuth_std": np.full(count, 2e-3),
        "range_rate": rng.uniform(-50.0, 50.0, count),
        "range_rate_std": np.full(count, 2.0),
    }


def _step(pipeline: Pipeline, events: Iterator[Event] | Rejection) -> None:
    """Step the tracker, and check that its estimates are finite."""
    if isinstance(events, Rejection):
        return
    for event in events:
        if isinstance(event, Stepped):
            published = (*event.step.filtered, *event.step.smoothed)
        else:
            published = tuple(event.smoothed)
        for own in published:
            _publish(own)


def _publish(found: Estimates) -> None:
    _require_finite(found.state, found.covariance, found.weight)
    interfaces.encode(estimates.to_msg(found, "map"))


def _estimates(stamp_ns: int) -> Estimates:
    """Return three tracks, one on either side of a seam and one at it."""
    state = np.array([[1e3, 9e1, 2e3, 5.0, 0.0], [5e4, -9e1, 2e3, 5.0, 0.01], [-3e4, 0, 1, 2, 0]])
    count = len(state)
    known = Attributes(
        np.tile([1e3, 1.0], (count, 1)),
        np.tile(np.eye(2), (count, 1, 1)),
        np.array([0o1234, 0o5, 0o7000]),
        np.arange(1, count + 1),
        np.full((count, len(SENSORS)), stamp_ns - NS),
    )
    return Estimates(
        stamp_ns=stamp_ns,
        lag=0,
        state=state,
        covariance=np.tile(np.diag([1e2, 1e1, 1e2, 1e1, 1e-4]), (count, 1, 1)),
        weight=np.ones(count),
        class_probability=np.full((count, 2), 0.5),
        class_id=np.zeros(count, dtype=np.int64),
        track_id=np.arange(1, count + 1),
        track_state=np.ones(count, dtype=np.int64),
        attributes=known,
    )


def _truth(stamp_ns: int) -> Truth:
    found = _estimates(stamp_ns)
    height = np.ones((len(found), 2))
    return Truth(stamp_ns, found.state, found.track_id, found.class_id, height=height)


def _hand_over(cloud: PointCloud2) -> None:
    """Join the estimates of two trackers, one of which sends a spoilt cloud."""
    found = estimates.from_msg(cloud)
    if picture.fault_of(found) is not None:
        return
    joined = JointPicture(REGIONS, 2e3, 0.0, 5.0)
    done = []
    for scan in range(4):
        usual = _estimates(found.stamp_ns + round((scan - 1) * INTERVAL_S * NS))
        if usual.stamp_ns < 0 or usual.stamp_ns >= 2**31 * NS:
            continue
        for source in SOURCES:
            for tracker in range(2):
                own = found if scan == 1 and not tracker else usual
                closed = joined.add(tracker, source, own)
                done += closed if isinstance(closed, list) else []
    for _, joint in [*done, *joined.close_all()]:
        _publish(joint)


def _to_asterix(cloud: PointCloud2) -> None:
    """Encode a spoilt cloud's tracks as ASTERIX, with places on the earth and without."""
    for plane in (None, SystemPlane([50.0, 8.0, 100.0])):
        output = TrackOutput(Source(1, 2), plane, 30.0, CallSigns())
        for each in (cloud, estimates.to_msg(_estimates(START_NS + NS), "map")):
            output.update(each)
            for ahead_s in (0, 1):
                output.datagrams(output.stamp_ns + ahead_s * NS)


def _evaluate(cloud: PointCloud2) -> None:
    found = estimates.from_msg(cloud)
    _score(found.stamp_ns, PointSet.of(_truth(found.stamp_ns)), PointSet.of(found))


def _evaluate_truth(cloud: PointCloud2) -> None:
    found = truth.from_msg(cloud)
    _score(found.stamp_ns, PointSet.of(found), PointSet.of(_estimates(found.stamp_ns)))


def _score(stamp_ns: int, targets: PointSet, found: PointSet) -> None:
    """Score a stamp between two usual ones; the node refuses unknown classes."""
    if max(targets.class_id.max(), found.class_id.max()) > 1:
        return
    evaluation = Evaluation(2, 1000.0, 2.0, 1000)
    usual = PointSet.of(_truth(START_NS)), PointSet.of(_estimates(START_NS))
    scans = ((stamp_ns - 4 * NS, *usual), (stamp_ns, targets, found), (stamp_ns + 4 * NS, *usual))
    for each_ns, true, own in scans:
        scores = evaluation.add_truth(each_ns, true)
        for source in SOURCES:
            scores += evaluation.add_estimates(source, each_ns, own)
        for score in scores:
            diagnostics.score_to_msg(score, 1000.0, 2.0)
    json.dumps(evaluation.summary(), allow_nan=False)
