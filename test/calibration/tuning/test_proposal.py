"""A recording's revolutions, noise, detections and clutter, against how it was simulated."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plot_recordings import one_target, recorded
from reference import resolve
from scenes import small

from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import Timing, plots_of
from phd_jdtc_ros.calibration.tuning.rates import crowded, outside_land, side_by_side
from phd_jdtc_ros.calibration.tuning.remarks import remarks
from phd_jdtc_ros.calibration.tuning.unspecified import unspecified
from phd_jdtc_ros.core.types import Detections, Pose
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.targets import Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

# Unlike the shipped recordings: nothing here may depend on their noise.
STANDING = {
    "radar_1.range_std": 80.0,
    "radar_1.azimuth_std_deg": 0.4,
    "radar_1.clutter_rate": 8.0,
    "radar_2.range_std": 30.0,
    "radar_2.azimuth_std_deg": 1.5,
    "radar_2.clutter_rate": 15.0,
}
TURNING = {
    "sensors": ["tower"],
    "tower.rotation_s": 5.0,
    "tower.range_std": 70.0,
    "tower.azimuth_std_deg": 0.15,
    "tower.max_range": 8e4,
    "tower.clutter_max_range": 8e4,
    "tower.clutter_rate": 12.0,
    "tower.detection_probability": 0.85,
    "tower.units.azimuth_convention": "compass_cw",
    "tower.fields.time": "time",
    "tower.fields.amplitude": "",
}


@pytest.fixture(scope="module")
def standing():
    config = small(STANDING)
    run = list(simulate(replace(paper_scenario(config.model.radars), scans=60), 3))
    return config, [
        plots_of([(scan.stamp_ns, scan.detections[index]) for _, scan in run]) for index in (0, 1)
    ]


def flights(count, seed):
    """Return aircraft all around that fly straight, and turn once."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        bearing, distance, course = rng.uniform([0.0, 2e4, 0.0], [6.28, 5e4, 6.28])
        speed, turn = rng.uniform(100.0, 220.0), rng.choice([-0.03, 0.0, 0.03])
        legs = (Leg(rng.uniform(60.0, 120.0)), Leg(25.0, turn), Leg(160.0))
        place = distance * math.cos(bearing), distance * math.sin(bearing)
        velocity = speed * math.cos(course), speed * math.sin(course)
        found.append(Flight(0, 1e3, 0.0, place, velocity, legs))
    return tuple(found)


def turning(seed=5, count=5, seconds=100, **given):
    config = resolve({**TURNING, **given})
    scene = Scenario(10**12, 1.0, seconds + 1, flights(count, seed), config.model.radars)
    reports = simulate_reports(scene, config.inputs, seed)
    return config, plots_of([(report.stamp_ns, report.detections) for report in reports])


@pytest.fixture(scope="module")
def estimated():
    config, plots = turning()
    return config, findings(plots)


def rows_of(estimated, **given):
    config, found = estimated
    values = {**config.values, **{f"tower.{name}": value for name, value in given.items()}}
    return {row.name: row for row in proposal.rows(found, values, "tower")}


def assert_estimated(found, radar, probability):
    """The goals of a proposal."""
    assert found.noise.range_std == pytest.approx(radar.range_std, rel=0.2)
    assert found.noise.azimuth_std == pytest.approx(radar.azimuth_std, rel=0.2)
    assert found.detection.value == pytest.approx(probability, abs=0.05)
    assert radar.clutter_rate / 1.5 < found.clutter.value < 1.5 * radar.clutter_rate


def test_parameters_of_a_stationary_radar_are_estimated_from_its_plots(standing):
    config, recordings = standing
    for radar, plots in zip(config.model.radars, recordings, strict=True):
        found = findings(plots)
        assert_estimated(found, radar, 0.985)
        assert (found.timing.rotation_s, found.timing.sectors) == (0.0, 0)
        assert found.timing.look_s == 6.0
        assert found.levels.false_alarm_probability == pytest.approx(1e-3, rel=0.1)
        assert found.levels.excess == pytest.approx(1.0, rel=0.2)
        assert found.field.arc is None
        assert found.field.clutter_range == pytest.approx(radar.visibility.clutter_range, rel=0.02)


def test_parameters_of_a_radar_that_reports_sectors_are_estimated_from_its_plots():
    config, plots = turning(**{"tower.sectors": 8})
    found = findings(plots)
    assert_estimated(found, config.model.radars[0], 0.85)
    assert found.timing.rotation_s == pytest.approx(5.0, rel=2e-3)
    assert (found.timing.sectors, found.timing.clockwise) == (8, True)
    assert found.levels is None


def test_parameters_of_a_radar_that_reports_whole_revolutions_are_estimated_from_its_plots(
    estimated,
):
    config, found = estimated
    assert_estimated(found, config.model.radars[0], 0.85)
    assert (found.timing.sectors, found.timing.clockwise) == (0, True)


def test_parameters_of_a_moving_radar_are_estimated_as_well(standing):
    config, recordings = standing
    radar, still = config.model.radars[0], recordings[0]
    drift = np.stack([8.0 * still.time_s, -5.0 * still.time_s, 0.002 * still.time_s], axis=1)
    reports = []
    for cloud, stamp_s in enumerate(still.cloud_s):
        own = np.flatnonzero(still.cloud == cloud)
        x, y, yaw = drift[own[0]]
        line = still.position[own] - [x, y]
        seen = np.stack([np.hypot(*line.T), np.arctan2(line[:, 1], line[:, 0]) - yaw], axis=1)
        pose = Pose((x, y), yaw)
        reports.append((round(stamp_s * 1e9), Detections(seen, still.amplitude[own], pose=pose)))
    moving = plots_of(reports)
    np.testing.assert_allclose(moving.position, still.position, atol=1e-6)
    assert findings(moving).noise.range_std == pytest.approx(radar.range_std, rel=0.25)


def test_recurring_places_are_separated_from_a_passing_target():
    rng, ship = np.random.default_rng(6), one_target(count=70)
    east = np.linspace(-2500.0, 2500.0, 20)
    coast = np.stack([np.hypot(east, 1500.0), np.arctan2(-1500.0, east)], axis=1)
    clouds = []
    for cloud in range(70):
        land = coast + rng.standard_normal(coast.shape) * [20.0, 0.01]
        clouds.append(np.concatenate([ship.measurement[ship.cloud == cloud], land]))
    plots = recorded(clouds)
    rows = outside_land(plots, 70.0, 20.0, 0.01)
    of_ship = np.flatnonzero(np.diff(plots.cloud, prepend=-1))
    assert np.isin(of_ship, rows).mean() > 0.95
    assert len(np.setdiff1d(rows, of_ship)) < 0.2 * 20 * 70
    moving = replace(plots, pose=rng.standard_normal(plots.pose.shape))
    assert len(outside_land(moving, 70.0, 20.0, 0.01)) == len(plots)


def test_a_target_that_stops_for_a_while_is_no_land():
    rng, clouds = np.random.default_rng(8), []
    for cloud in range(200):
        # It approaches, stays at 1000 m for two fifths of the time, and departs.
        distance = 1000.0 + 10.0 * (max(60 - cloud, 0) + max(cloud - 140, 0))
        drone = np.array([distance, 0.3]) + rng.standard_normal(2) * [2.0, 0.01]
        tower = np.array([500.0, -0.8]) + rng.standard_normal(2) * [2.0, 0.01]
        clouds.append(np.stack([drone, tower]))
    plots = recorded(clouds, 1.0)
    of_drone = np.flatnonzero(plots.measurement[:, 1] > 0.0)
    rows = outside_land(plots, 200.0, 2.0, 0.01)
    assert np.isin(of_drone, rows).all()
    # Plots at the edge of the noise are in cells of few plots.
    assert len(rows) < len(of_drone) + 0.3 * 200


def sea(looks, first, seed=3):
    """Return a recording of three targets from a look on, amid eighty echoes of the sea a look."""
    rng, clouds = np.random.default_rng(seed), []
    for look in range(looks):
        distance = rng.exponential(2e3, rng.poisson(80.0))
        found = np.column_stack([distance, rng.uniform(-np.pi, np.pi, len(distance))])
        if look >= first:
            seen = rng.random(3) < 0.85
            away = 15e3 - 200.0 * (look - first)
            targets = np.column_stack([np.full(3, away), [0.4, 2.0, -1.5]])
            targets = targets + rng.standard_normal((3, 2)) * [20.0, 5e-3]
            found = np.concatenate([found, targets[seen]])
        clouds.append(found[found[:, 0] < 16e3])
    return recorded(clouds, 2.0)


def test_clutter_of_the_sea_has_a_law_over_range_and_hides_no_targets():
    found = findings(sea(50, 0))
    assert found.tracks == 3
    assert found.crowded == 0.0
    proposed = {row.name: row.value for row in proposal.rows(found, {}, "radar")}
    assert "clutter_map" not in proposed
    ranges, density = proposed["clutter_density_range"], proposed["clutter_density"]
    near, far = np.interp([500.0, 8e3], ranges, density)
    assert np.log(near / far) == pytest.approx(7.5 / 2.0, rel=0.15)
    assert proposed["clutter_rate"] == pytest.approx(80.0, rel=0.1)


def test_targets_that_come_after_the_first_looks_are_found():
    assert findings(sea(70, 25)).tracks == 3


def test_uniform_clutter_has_no_law_over_range(standing):
    _, recordings = standing
    for plots in recordings:
        rows = proposal.rows(findings(plots), {}, "radar")
        assert not {row.name for row in rows if row.name.startswith("clutter_density")}


def test_areas_of_dense_clutter_are_mapped_and_spoil_no_noise(standing):
    config, (dry, _) = standing
    rng, radar, clouds, in_rain = np.random.default_rng(4), config.model.radars[0], [], []
    for cloud in range(len(dry.cloud_s)):
        places = dry.measurement[dry.cloud == cloud]
        # Each drop is somewhere else in the rain.
        rain = np.stack([rng.uniform(10e3, 12.5e3, 4), rng.uniform(-2.3, -2.0, 4)], axis=1)
        in_rain += [False] * len(places) + [True] * len(rain)
        clouds.append(np.concatenate([places, rain]))
    plots, drops = recorded(clouds, 6.0), np.flatnonzero(in_rain)

    found = findings(plots)
    assert found.clutter.value == pytest.approx(radar.clutter_rate + 4.0, rel=0.15)
    assert_estimated(replace(found, clutter=replace(found.clutter, value=8.0)), radar, 0.985)
    assert found.crowded == pytest.approx(len(drops) / len(plots), rel=0.25)
    proposed = {row.name: row.value for row in proposal.rows(found, {}, "radar")}
    # Targets that rest are still reported, because clutter does not come from the same places.
    assert (proposed["clutter_map"], proposed["clutter_map_speed"]) == (True, 0.0)
    given = {"radar.clutter_map": True, "radar.clutter_map_speed": 2.5}
    assert "clutter_map_speed" not in [row.name for row in proposal.rows(found, given, "radar")]

    dense = crowded(plots, np.arange(len(plots)))
    assert np.isin(drops, dense).mean() > 0.8  # The edge of the rain is in cells of few drops
    moving = replace(plots, pose=rng.standard_normal(plots.pose.shape))
    assert not len(crowded(moving, np.arange(len(plots))))


def scene_at_rest(count, probability, seed, speed=6.0):
    """Return four ships that move at least so fast, and things at rest that are seen so often."""
    rng, clouds = np.random.default_rng(seed), []
    places = rng.uniform([500.0, -3.0], [6e3, 3.0], (count, 2))
    start, course = rng.uniform(-2e3, 2e3, (4, 2)), rng.uniform(-3.0, 3.0, 4)
    velocity = speed * rng.uniform(1.0, 1.5, (4, 1)) * np.stack([np.cos(course), np.sin(course)], 1)
    for cloud in range(60):
        x, y = (start + 3.0 * cloud * velocity).T
        ships = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)[rng.random(4) < 0.9]
        seen = np.concatenate([ships, places[rng.random(count) < probability]])
        clouds.append(seen + rng.standard_normal(seen.shape) * [10.0, 0.004])
    return recorded(clouds, 3.0)


def rows_and_remarks(plots, given):
    found = findings(plots)
    rows = {row.name: row.value for row in proposal.rows(found, given, "mast") if row.proposed}
    return found, rows, [*remarks(found, given, "mast")]


def test_many_echoes_at_rest_that_are_often_missed_are_mapped():
    found, rows, said = rows_and_remarks(scene_at_rest(60, 0.6, 1), {})
    assert rows["clutter_map"] is True
    assert "clutter_map_speed" not in rows  # The ships are much faster than the default
    assert found.clutter.value < 3.0
    assert len(said) == 1
    assert "targets slower than 2.5 m/s are not reported" in said[0]
    assert "set mast.clutter_map_speed to 0" in said[0]
    for given in ({"mast.clutter_map": True}, {"mast.clutter_map_speed": 0.0}):
        assert not [*remarks(found, given, "mast")]


def test_a_map_hides_no_target_that_moves():
    _, rows, said = rows_and_remarks(scene_at_rest(60, 0.6, 2, speed=2.0), {})
    assert 0.5 < rows["clutter_map_speed"] < 1.6
    assert f"slower than {rows['clutter_map_speed']:g} m/s" in said[0]


def test_echoes_of_a_quay_are_side_by_side_and_moored_boats_are_not():
    rng = np.random.default_rng(8)
    quay = np.stack([np.full(130, 2e3), np.linspace(0.0, 1.0, 130)], axis=1)
    boats = rng.uniform([500.0, -3.0], [6e3, 3.0], (130, 2))
    for places, low, high in ((quay, 0.9, 1.0), (boats, 0.0, 0.1)):
        clouds = [places + rng.standard_normal(places.shape) * [10.0, 0.004] for _ in range(9)]
        plots = recorded(clouds, 3.0)
        share = side_by_side(plots, Timing(3.0), 10.0, 0.004, np.arange(len(plots)))
        assert low <= share <= high


@pytest.mark.parametrize(("count", "probability"), [(3, 0.9), (8, 0.6), (30, 0.9), (130, 0.9)])
def test_what_may_be_targets_at_rest_is_not_mapped(count, probability):
    found, rows, said = rows_and_remarks(scene_at_rest(count, probability, 3), {})
    assert not {"clutter_map", "clutter_map_speed"} & {*rows}
    assert found.tracks >= 0.95 * (4 + count)
    assert found.speed_std > 3.0  # The ships that move
    assert len(said) == 1
    assert "may be of targets at rest, which are tracked" in said[0]
    assert "set mast.clutter_map to true" in said[0]


def test_a_class_at_rest_decides_instead_of_the_map():
    given = {"classes": ["ship", "fixed"], "ship.motions": ["cv"], "fixed.motions": ["rest"]}
    given |= {"cv.model": "constant_velocity", "rest.model": "stationary"}
    _, rows, said = rows_and_remarks(scene_at_rest(60, 0.6, 1), given)
    assert "clutter_map" not in rows
    assert not said


def test_insufficient_recordings_name_what_is_missing():
    nothing = recorded([np.zeros((0, 2))] * 50, 1.0)
    with pytest.raises(TuningError, match=r"0 detections in 49.0 s, must be at least 30"):
        findings(nothing)
    with pytest.raises(TuningError, match=r"5 clouds in 8.0 s, must be at least 10"):
        findings(one_target(count=5))
    only = one_target(count=40, missed=set(range(40)), clutter=5)
    with pytest.raises(TuningError, match=r"0 targets with 0 detections are distinct from clutter"):
        findings(only)
    with pytest.raises(TuningError, match=r"range is [\d.e+]+ m, and azimuths span 3\d\d degrees$"):
        findings(only)
    frozen = recorded([np.ones((5, 2))] * 20, 0.0)
    with pytest.raises(TuningError, match="all clouds have the same stamp"):
        findings(frozen)


def test_wrong_units_are_named_where_no_target_is_found():
    metres = one_target(count=60, clutter=3)
    plots = replace(metres, measurement=metres.measurement * [1e-3, 1.0])
    expected = r"range is [\d.]+ m, .*; 1 targets are found if .* probably they are in kilometres"
    with pytest.raises(TuningError, match=expected):
        findings(plots)


def test_scans_whose_detections_have_a_stamp_each_are_named():
    scans = one_target(count=60, clutter=8)
    own_s = scans.time_s + 1e-4 * np.random.default_rng(3).random(len(scans))
    order = np.argsort(own_s)
    rows = replace(scans.only(order), cloud=np.arange(len(order)))
    rows = replace(rows, time_s=own_s[order], cloud_s=own_s[order])
    expected = r"degrees; most clouds have one detection: all those of a scan must have the same"
    with pytest.raises(TuningError, match=expected):
        findings(rows)


def test_milliseconds_are_named_where_a_turning_antenna_has_times_of_single_plots():
    seconds = turning()[1].until(120.0)
    own_s = 1e3 * seconds.time_s
    plots = replace(seconds, cloud=np.arange(len(own_s)), cloud_s=own_s, time_s=own_s, timed=True)
    expected = r"\d+ targets are found if times are divided by 1000: .* in milliseconds$"
    with pytest.raises(TuningError, match=expected):
        findings(plots)


def test_rows_list_proposed_and_current_values(estimated):
    rows = rows_of(estimated)
    assert (rows["rotation_s"].value, rows["rotation_s"].now) == (5.0, 5.0)
    assert 0.03 < rows["range_std"].std / rows["range_std"].value < 0.15
    assert rows["range_std"].now == 70.0
    assert rows["detection_probability"].proposed
    # Nothing was seen beyond.
    assert not rows["max_range"].proposed
    assert rows_of(estimated, max_range=30e3)["max_range"].proposed
    assert rows_of(estimated, max_range=900e3)["max_range"].proposed
    learned = ["noise", "outliers", "detection", "correlation", "clutter", "multipath"]
    rows = rows_of(estimated, learn=learned)
    assert not rows["clutter_rate"].proposed
    assert rows["range_std"].proposed
    assert (rows["learn"].now, rows["learn"].value) == (learned, ["clutter", "multipath"])
    # The noise of range rates is not estimated.
    rows = rows_of(estimated, **{"learn": learned, "fields.range_rate": "rate"})
    assert rows["learn"].value == ["noise", "clutter", "multipath"]


def test_bounds_that_the_bridge_sets_are_kept(estimated):
    config, found = estimated
    found = replace(found, noise=replace(found.noise, range_std=2.2, azimuth_std=1e-4))
    bridged = {"geodetic": [50.0, 8.0, 100.0], "learn": ["clutter"], "clutter_max_range": 9e4}
    rows = rows_of((config, found), **bridged)
    assert (rows["range_std"].value, rows["azimuth_std_deg"].value) == (5.0, 0.01)
    assert "show 2.2" in rows["range_std"].source
    assert not rows["clutter_max_range"].proposed
    flat = rows_of((config, found))
    assert (flat["range_std"].value, flat["clutter_max_range"].proposed) == (2.2, True)


@pytest.mark.parametrize(
    ("engine", "given"), [("gaussian", (55.0, ["outliers"])), ("phd", (70.0, None))]
)
def test_outliers_are_proposed_to_the_engine_that_knows_them(estimated, engine, given):
    config, found = estimated
    usual = replace(found.noise, range_std=70.0)
    found = replace(found, noise=usual, with_outliers=replace(usual, range_std=55.0, outliers=True))
    rows = proposal.rows(found, {**config.values, "engine": engine}, "tower")
    proposed = {row.name: row.value for row in rows}
    assert (proposed["range_std"], proposed.get("learn")) == given


@pytest.mark.parametrize("learn", [[], ["detection"]])
@pytest.mark.parametrize(
    ("given", "proposed"), [(0.5, True), ([0.9, 0.8], False), ([0.5, 0.4], True)]
)
def test_a_detection_probability_is_proposed_unless_a_table_agrees(
    estimated, learn, given, proposed
):
    table = {"detection_probability": given, "detection_probability_range": [0.0, 8e4]}
    rows = rows_of(estimated, learn=learn, **table)
    row = rows["detection_probability"]
    assert (row.proposed, row.value) == (proposed, pytest.approx(0.85, abs=0.06))
    # A number is the same for all ranges.
    assert ("detection_probability_range" in rows) == (proposed and isinstance(given, list))
    assert ("learn" in rows) == bool(learn)


@pytest.mark.parametrize(("rate", "survival"), [(0.002, 0.998), (0.03, 0.99), (2e-6, 0.999998)])
def test_survival_is_the_highest_that_the_ends_of_tracks_allow(estimated, rate, survival):
    _, found = estimated
    long = replace(found, ends=replace(found.ends, value=rate))
    # The other radar looks half as often, and loses targets more often.
    slow = replace(
        long,
        timing=replace(found.timing, rotation_s=2.0 * found.timing.rotation_s),
        ends=replace(long.ends, value=2.5 * rate),
    )
    values = unspecified({"a": long, "b": slow})
    assert values["target.survival_probability"] == pytest.approx(survival, abs=1e-9)


def test_frequent_looks_do_not_enlarge_the_accelerations_of_slow_targets(estimated):
    _, found = estimated
    noise = replace(found.noise, range_std=25.0, densities=(1e-5, 0.1))
    ships = replace(found, timing=Timing(1.0), noise=noise, with_outliers=None)
    values = unspecified({"mast": ships})
    assert values["cv.noise_density"] < 0.2
    assert values["hard.noise_density"] < 4.0
    fast = replace(ships, noise=replace(noise, densities=(2.0, 90.0)))
    values = unspecified({"mast": fast})
    levels = [values[f"{motion}.noise_density"] for motion in ("cv", "ct", "hard")]
    assert levels == [2.0, 2.0, 90.0]


@pytest.mark.parametrize(("look_s", "rate"), [(4.0, 0.2), (1.0, 0.2), (0.1, 0.02)])
def test_new_targets_are_expected_by_the_second_where_looks_are_frequent(estimated, look_s, rate):
    found = replace(estimated[1], timing=Timing(look_s))
    assert unspecified({"lidar": found})["detection_births.rates"] == [rate]


def test_unspecified_tracker_is_one_that_the_configuration_takes(estimated):
    _, found = estimated
    values = unspecified({"tower": found, "other": found})
    config = resolve({"sensors": ["tower", "other"], **values})
    assert config.engine == "gaussian"
    assert config.values["interval_s"] == 5.0
    assert config.values["amplitude"] == "none"


@pytest.mark.parametrize(
    ("hidden", "share"),
    [
        ({"min_range": 5e3}, 1.0),
        # Sectors too narrow for a proposed field of view, and one that is outside it.
        ({"blind_sectors_deg": [20.0, 36.0, 80.0, 96.0, 140.0, 156.0, 200.0, 216.0]}, 1.0),
        ({"blind_sectors_deg": [20.0, 110.0]}, 0.75),
    ],
    ids=["near", "obstructed", "outside the field of view"],
)
def test_the_proposed_rate_counts_the_clutter_that_cannot_be_read(standing, hidden, share):
    config, (_, plots) = standing
    given = {f"radar.{name}": value for name, value in hidden.items()}
    sight = resolve({"sensors": ["radar"], **given}).model.radars[0].visibility
    found = findings(plots.only(np.flatnonzero(sight.probability_in_view(plots.measurement) > 0.0)))
    rows = proposal.rows(found, given, "radar")
    proposed = {row.name: row.value for row in rows}
    rate = share * config.model.radars[1].clutter_rate
    assert proposed["clutter_rate"] == pytest.approx(rate, rel=0.1)


@pytest.mark.parametrize("ambiguity", [0.0, 12.0])
def test_the_noise_of_range_rates_is_estimated(ambiguity):
    rng, reports = np.random.default_rng(6), []
    for look in range(150):
        time_s = 0.2 * look
        place = np.array([[400.0 - 9.0 * time_s, 200.0], [-300.0, 100.0 + 6.0 * time_s]])
        velocity = np.array([[-9.0, 0.0], [0.0, 6.0]])
        distance = np.hypot(*place.T)
        rate = (place * velocity).sum(axis=1) / distance + 0.3 * rng.standard_normal(2)
        if ambiguity:
            rate -= ambiguity * np.rint(rate / ambiguity)
        measured = np.column_stack([distance, np.arctan2(place[:, 1], place[:, 0])])
        measured += rng.standard_normal((2, 2)) * [1.5, 0.01]
        false = rng.uniform([20.0, -np.pi], [600.0, np.pi], (rng.poisson(3.0), 2))
        rates = np.append(rate, rng.uniform(-6.0, 6.0, len(false)))
        found = Detections(np.concatenate([measured, false]), None, range_rate=rates)
        reports.append((round(2e8 * look), found))
    found = findings(plots_of(reports, ambiguity=ambiguity))
    rows = {row.name: row for row in proposal.rows(found, {}, "radar")}
    assert rows["range_rate_std"].value == pytest.approx(0.3, rel=0.15)
    assert found.tracks == 2
