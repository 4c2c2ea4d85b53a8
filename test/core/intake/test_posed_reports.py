import itertools

import moving
import numpy as np
import pytest
from runs import ENGINES

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import RunEnded
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import Pose


def reports(count=moving.SCANS):
    """Return the radar's reports as steps: the name of the pipeline's method and its arguments."""
    return [
        ("add", (0, moving.stamp(index * moving.INTERVAL_S), found))
        for index, found in enumerate(moving.scans(count))
    ]


def poses(first_s=-0.1, last_s=moving.SCANS * moving.INTERVAL_S, every_s=0.2):
    times = np.arange(first_s, last_s, every_s)
    return [("add_pose", (0, moving.stamp(t), moving.ship(t))) for t in times]


def in_order(*parts):
    return sorted(itertools.chain(*parts), key=lambda step: step[1][1])


def fed(pipeline, steps):
    """Return the events of steps, those that were refused, and the flush's events."""
    events, refused = [], []
    for method, arguments in steps:
        found = getattr(pipeline, method)(*arguments)
        if isinstance(found, (Rejection, PoseFault)):
            refused.append(found)
        else:
            events += found
    events += pipeline.flush()
    return [event for event in events if not isinstance(event, RunEnded)], refused


def filtered(events):
    return [estimates for event in events for estimates in event.step.filtered]


@pytest.mark.parametrize("engine", ENGINES)
def test_targets_are_tracked_in_the_world_from_a_ship_that_turns(engine):
    settings = moving.config(engine=engine, particles_per_target=500)
    events, refused = fed(new_pipeline(settings), in_order(reports(), poses()))
    assert len(events) == moving.SCANS
    assert not refused
    assert np.median(moving.errors(filtered(events))) < 6.0
    assert moving.errors(filtered(events)).max() < 25.0


def test_a_ship_that_stands_is_the_same_as_a_fixed_radar():
    (x, y), yaw = (120.0, -40.0), 0.3
    place = {"mast.position": [x, y], "mast.yaw_deg": float(np.degrees(yaw))}
    fixed, _ = fed(new_pipeline(moving.config(**place, **{"mast.pose": "fixed"})), reports())
    still = [
        ("add_pose", (0, moving.stamp(t), Pose((x, y), float(np.radians(np.degrees(yaw))))))
        for t in range(-1, 60)
    ]
    there = {"mast.position": [0.0, 0.0], "mast.yaw_deg": 0.0}
    carried, _ = fed(new_pipeline(moving.config(**there)), in_order(reports(), still))
    for one, other in zip(filtered(fixed), filtered(carried), strict=True):
        np.testing.assert_array_equal(one.state, other.state)


def test_the_order_in_which_poses_and_reports_come_makes_no_difference():
    def delayed(later_ns):
        """Return the steps with poses that come this much later than their stamps."""
        return sorted(
            [*poses(), *reports()],
            key=lambda step: step[1][1] + (later_ns if step[0] == "add_pose" else 0),
        )

    runs = [
        filtered(fed(new_pipeline(moving.config()), delayed(later_ns))[0])
        for later_ns in (-1_500_000_000, 1_900_000_000)
    ]
    for one, other in zip(*runs, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.state, other.state)


def test_a_report_waits_until_its_pose_is_known():
    pipeline = new_pipeline(moving.config())
    list(pipeline.add_pose(0, moving.stamp(-0.1), moving.ship(-0.1)))
    assert list(pipeline.add(*reports(1)[0][1])) == []
    assert pipeline.waiting
    (event,) = pipeline.add_pose(0, moving.stamp(0.1), moving.ship(0.1))
    assert event.scan.detections[0].pose.position == pytest.approx(moving.antenna(0.0)[0], abs=0.1)


def test_poses_that_stop_are_bridged_for_a_moment_and_then_reports_are_given_up():
    until_s = 10 * moving.INTERVAL_S - 0.5
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, in_order(reports(), poses(last_s=until_s)))
    assert len(events) == 11
    assert pipeline.take_anomalies(0) == {"poses_extrapolated": 1}
    assert pipeline.take_drops(0) == {"pose_missing": moving.SCANS - 11}


def test_tracking_goes_on_when_poses_come_back():
    gap = [*poses(last_s=13.2), *poses(first_s=19.5)]
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, in_order(reports(), gap))
    assert pipeline.take_drops(0) == {"pose_missing": 2}
    assert moving.errors(filtered(events), since=14).max() < 25.0


def test_a_pose_that_jumps_moves_no_detection():
    wild = [("add_pose", (0, moving.stamp(20.05), Pose((9e3, 9e3), 2.0)))]
    events, refused = fed(new_pipeline(moving.config()), in_order(reports(), poses(), wild))
    plain, _ = fed(new_pipeline(moving.config()), in_order(reports(), poses()))
    assert refused == [PoseFault.JUMP]
    for one, other in zip(filtered(events), filtered(plain), strict=True):
        np.testing.assert_array_equal(one.state, other.state)


def test_a_report_that_comes_twice_is_counted_when_its_pose_is_known():
    steps = in_order(reports(), reports()[3:4], poses())
    pipeline = new_pipeline(moving.config())
    events, _ = fed(pipeline, steps)
    assert len(events) == moving.SCANS
    assert pipeline.take_drops(0) == {"duplicate": 1}


def test_a_run_that_begins_again_is_tracked_again():
    steps = in_order(reports(), poses())
    pipeline = new_pipeline(moving.config())
    events = [event for method, args in steps + steps for event in getattr(pipeline, method)(*args)]
    events += pipeline.flush()
    stepped = [event for event in events if not isinstance(event, RunEnded)]
    assert len(stepped) >= 2 * moving.SCANS - 1
    assert len(events) - len(stepped) == 2


@pytest.mark.parametrize("sectors", [0, 8])
def test_slices_of_a_turn_have_poses_of_their_own(sectors):
    rotation_s = 4.0
    settings = moving.config(
        **{"mast.rotation_s": rotation_s, "mast.sectors": sectors, "mast.fields.time": "time"}
    )
    pipeline, given = new_pipeline(settings), []
    rng = np.random.default_rng(3)
    list(pipeline.add_pose(0, moving.stamp(-0.1), moving.ship(-0.1)))
    parts = max(sectors, 1)
    for part in range(6 * parts):
        end_s = rotation_s * (part + 1) / parts
        time_s = np.sort(rng.uniform(end_s - rotation_s / parts, end_s, 48 // parts))
        azimuth = np.mod(2 * np.pi * time_s / rotation_s + np.pi, 2 * np.pi) - np.pi
        found = moving.Detections(
            np.stack([np.full(len(time_s), 800.0), azimuth], axis=1), None, time_s - end_s
        )
        given += pipeline.add(0, moving.stamp(end_s), found)
        for t in np.arange(end_s - rotation_s / parts + 0.05, end_s + 0.1, 0.1):
            events = pipeline.add_pose(0, moving.stamp(t), moving.ship(t))
            given += [] if isinstance(events, PoseFault) else events
    slices = [event.scan for event in given if not isinstance(event, RunEnded)]
    assert len(slices) > 40
    for part in slices:
        (found,) = part.detections
        time_s = (part.stamp_ns - moving.START_NS) * 1e-9
        place, yaw = moving.antenna(time_s)
        assert found.pose.position == pytest.approx(tuple(place), abs=0.02)
        assert np.cos(found.pose.yaw - yaw) == pytest.approx(1.0, abs=1e-6)


def test_a_radar_at_a_pose_measures_from_there():
    model: RadarModel = moving.config().model.radars[0]
    pose = Pose((100.0, -50.0), 1.0)
    state = np.array([[300.0, 2.0, 400.0, -1.0, 0.0]])
    measured = model.at(pose).measure(state)
    line = state[0, [model.space.position[0], model.space.position[1]]] - pose.position
    assert measured[0, 0] == pytest.approx(np.hypot(*line))
    assert measured[0, 1] == pytest.approx(np.arctan2(line[1], line[0]) - 1.0)
    assert model.at(None) is model
