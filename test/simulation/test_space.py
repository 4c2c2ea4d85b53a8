"""Simulated targets with heights, and the detections of radars in space."""

import numpy as np
import pytest

from msg_adapters.encoding import point_cloud
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.poses import Mount
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.simulate import simulate_with_sources
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

LOW, HIGH = -2.0, 40.0
PARAMETERS = {
    "state": "space",
    "sensors": ["dome", "flat"],
    "dome.position": [100.0, 50.0, 20.0],
    "dome.fields.elevation": "elevation",
    "dome.fields.range_rate": "range_rate",
    "flat.position": [-500.0, 0.0, 5.0],
    "births": [],
    **{
        f"{name}.{key}": value
        for name in ("dome", "flat")
        for key, value in {
            "range_std": 2.0,
            "azimuth_std_deg": 0.5,
            "fov_elevation_deg": [LOW, HIGH],
            "detection_probability": 0.95,
            "clutter_rate": 20.0,
            "max_range": 5e3,
            "clutter_max_range": 5e3,
        }.items()
    },
}
LEGS = [
    {"duration_s": 20.0, "climb": 5.0},
    {"duration_s": 60.0},
    {"duration_s": 60.0, "climb": -1.0},
]
DOCUMENT = {
    "start_s": 1000.0,
    "interval_s": 1.0,
    "scans": 120,
    "targets": [
        {
            "class_id": 0,
            "position": [2000.0, 0.0],
            "velocity": [5.0, 3.0],
            "height": 300.0,
            "legs": LEGS,
        },
        # Above the field of view of both.
        {
            "class_id": 0,
            "position": [200.0, 100.0],
            "velocity": [0.1, 0.0],
            "height": 900.0,
            "legs": [{"duration_s": 140.0}],
        },
    ],
}


def scene(**more):
    """Return the models of the radars, and the scenario."""
    config = resolve({**PARAMETERS, **more})
    radars = config.model.radars
    return config, scenario_file.resolve(DOCUMENT, radars)


def test_flight_climbs_leg_by_leg():
    legs = tuple(Leg(leg["duration_s"], climb=leg.get("climb", 0.0)) for leg in LEGS)
    flight = Flight(0, 100.0, 10.0, (0.0, 0.0), (10.0, 0.0), legs, 300.0)
    times = np.array([10.0, 20.0, 30.0, 60.0, 100.0])
    found = flight.heights(times)
    np.testing.assert_allclose(found[:, 0], [300.0, 350.0, 400.0, 400.0, 390.0])
    np.testing.assert_allclose(found[:, 1], [5.0, 5.0, 0.0, 0.0, -1.0])


def test_detections_in_space_are_of_the_true_heights_with_the_noise_of_the_radar():
    config, scenario = scene()
    errors, elevations, rates = [], [], []
    dome = config.model.radars[0]
    for truth, scan, (sources, _) in simulate_with_sources(scenario, 3):
        found = scan.detections[0]
        assert 2 not in sources  # It is above the field of view
        state = np.zeros((1, len(SPATIAL)))
        state[0, :5], state[0, 5:] = truth.state[0], truth.height[0]
        for row in np.flatnonzero(sources == 1):
            errors.append(dome.wrap(found.measurement[row] - dome.measure(state)[0]))
            rates.append(found.range_rate[row] - dome.range_rate_of(state)[0])
        elevations += found.measurement[sources == 0, 2].tolist()
    assert len(errors) > 100
    np.testing.assert_allclose(np.std(errors, axis=0) / dome.noise_std, 1.0, atol=0.25)
    assert np.std(rates) == pytest.approx(dome.range_rate.std, rel=0.25)
    # Clutter is uniform on the sphere between the limits.
    sines = (np.sin(elevations) - np.sin(np.radians(LOW))) / np.diff(
        np.sin(np.radians([LOW, HIGH]))
    )
    assert 0.0 <= sines.min() < 0.05
    assert sines.mean() == pytest.approx(0.5, abs=0.03)


def test_clouds_of_radars_in_space_are_read_again():
    config, scenario = scene()
    _, scan, _ = simulate_with_sources(scenario, 3)[5]
    for layout, found in zip(config.inputs, scan.detections, strict=True):
        cloud = adapter.to_msg(found, scan.stamp_ns, layout.frame, layout)
        again = adapter.from_msg(cloud, layout).detections
        axes = 3 if layout.name == "dome" else 2
        np.testing.assert_allclose(
            again.measurement[:, :axes], found.measurement[:, :axes], rtol=1e-6, atol=1e-6
        )
        columns = point_cloud.decode(cloud, dict.fromkeys("xyz", point_cloud.FLOATS))
        place = np.stack([columns[axis] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(
            np.linalg.norm(place, axis=1), found.measurement[:, 0], rtol=1e-5
        )
    # Without the name of a field for it, no elevation is known.
    assert (again.noise_std[:, 2] == UNKNOWN_STD).all()


def test_radars_on_a_platform_that_swings_measure_from_its_pose():
    moving = {f"{name}.pose": "/ship/odom" for name in ("dome", "flat")}
    moving |= {"dome.position": [3.0, 1.0, 8.0], "dome.tilt_deg": [5.0, 0.0]}
    moving |= {"dome.fields.range_rate": ""}
    config = resolve({**PARAMETERS, **moving, "world_frame": "map"})
    ship = {
        "radars": ["dome", "flat"],
        "position": [-400.0, 200.0],
        "velocity": [8.0, 3.0],
        "height": 30.0,
        "pitch_deg": 4.0,
        "roll_deg": 12.0,
        "swing_s": 7.0,
        "legs": [{"duration_s": 140.0, "climb": 0.5}],
    }
    document = {**DOCUMENT, "platform": {**ship, "radars": ["dome"]}}
    scenario = scenario_file.resolve(document, config.model.radars)
    errors, dome = [], config.model.radars[0]
    mount = Mount((3.0, 1.0), dome.yaw, 8.0, dome.tilt)
    for (truth, scan, (sources, _)), (_, pose) in zip(
        simulate_with_sources(scenario, 3), scenario.poses()[::2], strict=True
    ):
        state = np.zeros((1, len(SPATIAL)))
        state[0, :5], state[0, 5:] = truth.state[0], truth.height[0]
        exact = dome.at(mount.on(pose)).measure(state)[0]
        found = scan.detections[0].measurement[sources == 1]
        errors += [dome.wrap(each - exact) for each in found]
    assert len(errors) > 60
    np.testing.assert_allclose(np.std(errors, axis=0) / dome.noise_std, 1.0, atol=0.3)
    rolls = [np.degrees(pose.tilt[1]) for _, pose in scenario.poses()]
    assert max(rolls) == pytest.approx(12.0, abs=0.1)
    assert scenario.poses()[-1][1].height == pytest.approx(30.0 + 0.5 * 119.0)


def test_a_radar_that_turns_sees_targets_at_their_heights_when_its_beam_passes():
    turning = {"rotation_s": 4.0, "fields.time": "time", "sectors": 8}
    config, scenario = scene(**{f"dome.{name}": value for name, value in turning.items()})
    assert scenario.turning
    dome, reports = config.model.radars[0], simulate_reports(scenario, config.radars, 3)
    errors, rates, elevations, seen = [], [], [], 0
    for report in reports:
        if report.radar:  # Radar 0, flat, stares beside it.
            assert report.detections.measurement.shape[1:] == (3,)
            continue
        found, sources = report.detections, report.source
        assert 2 not in sources  # Target 2 is above the field of view.
        elevations += found.measurement[sources == 0, 2].tolist()
        for row in np.flatnonzero(sources == 1):
            after_s = report.stamp_ns * 1e-9 - 1000.0 + float(found.time_s[row])
            time, flight = np.array([after_s]), scenario.flights[0]
            state = np.column_stack([flight.states(time), flight.heights(time)])
            errors.append(dome.wrap(found.measurement[row] - dome.measure(state)[0]))
            rates.append(found.range_rate[row] - dome.range_rate_of(state)[0])
            seen += 1
    assert seen == pytest.approx(0.95 * 119.0 / 4.0, abs=4.0)
    np.testing.assert_allclose(np.std(errors, axis=0) / dome.noise_std, 1.0, atol=0.4)
    assert np.std(rates) == pytest.approx(dome.range_rate.std, rel=0.4)
    assert np.degrees([min(elevations), max(elevations)]) == pytest.approx([LOW, HIGH], abs=1.0)


def test_turning_radars_on_platforms_are_refused_in_space():
    ship = {"radars": ["dome"], "position": [0.0, 0.0], "velocity": [1.0, 0.0]}
    document = {**DOCUMENT, "platform": {**ship, "legs": [{"duration_s": 140.0}]}}
    turning = {"dome.rotation_s": 4.0, "dome.fields.range_rate": "", "dome.pose": "/ship/odom"}
    config = resolve({**PARAMETERS, **turning, "world_frame": "map"})
    with pytest.raises(ConfigError, match="must be plane where a radar on a platform turns"):
        scenario_file.resolve(document, config.model.radars)
