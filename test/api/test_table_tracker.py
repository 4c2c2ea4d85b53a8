"""Tables of detections to tables of tracks."""

import copy
import itertools
import pickle
import warnings

import crossing
import numpy as np
import pytest
import yaml

from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros import Tracker, evaluate, simulate
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.pipeline import RunEnded
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files

DETECTIONS, TRUTH = crossing.detections(), crossing.truth()


def with_radar(**changes):
    """Return the usual parameters with others of the radar."""
    return {**crossing.PARAMETERS, "radar": {**crossing.PARAMETERS["radar"], **changes}}


def assert_same(found, expected):
    assert found.dtype == expected.dtype
    for name in found.dtype.names:
        np.testing.assert_array_equal(found[name], expected[name])


@pytest.fixture(scope="module")
def tracked():
    """Return the tracks of the usual table with the usual parameters."""
    return Tracker(crossing.PARAMETERS).track(DETECTIONS)


def test_track_finds_two_targets_that_cross(tracked):
    scores = evaluate(TRUTH, tracked.smoothed, cutoff=50.0)
    assert scores["identity_switches"] == 0
    assert scores["ospa"] < 8.0
    assert set(tracked.smoothed["class"]) == {"target"}


@pytest.mark.parametrize(
    "rotations_s", [(2.5, 4.0, 6.0), (4.0, 0.0)], ids=["unequal", "beside a fast sensor"]
)
def test_plots_of_turning_antennas_beside_other_sensors_are_all_used(rotations_s):
    rng, columns = np.random.default_rng(5), {"time": [], "radar": [], "range": [], "azimuth": []}
    radar = {
        "range_std": 50.0,
        "azimuth_std_deg": 0.1,
        "max_range": 5e4,
        "detection_probability": 0.9,
        "clutter_rate": 5.0,
    }
    sections = {}
    for number, rotation_s in enumerate(rotations_s):
        times = np.arange(0.0, 90.0, rotation_s / 12 if rotation_s else 0.1) + rng.uniform(0.0, 0.1)
        columns["time"] += times.tolist()
        columns["radar"] += [f"radar_{number}"] * len(times)
        columns["range"] += rng.uniform(1e3, 4e4, len(times)).tolist()
        azimuth = 2.0 * np.pi * times / (rotation_s or 7.0)
        columns["azimuth"] += (np.remainder(azimuth + np.pi, 2.0 * np.pi) - np.pi).tolist()
        turning = {"rotation_s": rotation_s, "fields": {"time": "time"}} if rotation_s else {}
        sections[f"radar_{number}"] = {**radar, **turning}
    births = {"std": [100.0]}
    tracker = Tracker(
        {"sensors": [*sections], "interval_s": 2.5, "detection_births": births, **sections}
    )
    tracker.track({name: np.array(values) for name, values in columns.items()})
    assert not tracker.dropped


# A sensor of the same detections as positions.
PLACES = {
    "interval_s": 1.0,
    "radar": {
        "position_std": 6.0,
        "area": [-1500.0, -1500.0, 1500.0, 1500.0],
        "clutter_rate": 2.0,
    },
    "detection_births": {"std": [15.0]},
}


def test_positions_are_tracked_in_the_world_and_from_where_a_sensor_is():
    table = crossing.cartesian(DETECTIONS)
    found = Tracker(PLACES).track(table).smoothed
    assert evaluate(TRUTH, found, cutoff=50.0)["ospa"] < 8.0
    turned = {"x": table["y"] - 200.0, "y": -300.0 - table["x"]}
    given = {**PLACES, "radar": {**PLACES["radar"], "position": [-300.0, 200.0], "yaw_deg": 90.0}}
    given["radar"]["area"] = [-2000.0, -2000.0, 2000.0, 2000.0]
    found = Tracker(given).track({"time": table["time"], **turned}).smoothed
    assert evaluate(TRUTH, found, cutoff=50.0)["ospa"] < 8.0


def test_parameters_of_a_radar_are_refused_for_positions():
    with pytest.raises(ConfigError) as raised:
        Tracker(crossing.PARAMETERS).track(crossing.cartesian(DETECTIONS))
    assert raised.value.faults[0] == (
        "radar.range_std: given, but the table has x and y and no range: positions, with "
        "position_std and area"
    )


def test_velocities_of_a_table_are_used():
    rng, table = np.random.default_rng(1), crossing.cartesian(DETECTIONS)
    seen = {name: TRUTH[name] + 6.0 * rng.standard_normal(len(TRUTH["x"])) for name in ("x", "y")}
    speeds = {name: TRUTH[name] + rng.standard_normal(len(TRUTH["x"])) for name in ("vx", "vy")}
    given = {**PLACES, "radar": {**PLACES["radar"], "velocity_std": 1.0}}
    table = {"time": TRUTH["time"], **seen}
    error = {}
    for name, columns in {"without": table, "with": {**table, **speeds}}.items():
        found = Tracker(given).track(columns).filtered
        error[name] = evaluate(TRUTH, found, cutoff=50.0)["position_rms"]
    assert error["with"] < 0.8 * error["without"]


def test_csv_gives_what_arrays_give_in_any_order_of_rows(tmp_path, tracked):
    path = tmp_path / "detections.csv"
    order = np.argsort(-DETECTIONS["time"], kind="stable")
    rows = np.column_stack([*DETECTIONS.values()])[order].tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text("\n".join([",".join(DETECTIONS), *lines]))
    assert_same(Tracker(crossing.PARAMETERS).track(path).smoothed, tracked.smoothed)


def test_azimuths_are_read_by_the_parameters(tracked):
    compass = {**DETECTIONS, "azimuth": 90.0 - np.degrees(DETECTIONS["azimuth"])}
    parameters = with_radar(units={"azimuth_convention": "compass_cw", "azimuth": "deg"})
    found = Tracker(parameters).track(compass).smoothed
    np.testing.assert_array_equal(found["label"], tracked.smoothed["label"])
    np.testing.assert_allclose(found["x"], tracked.smoothed["x"])


def test_positions_have_deviations_of_their_own():
    table = crossing.cartesian(DETECTIONS)

    def spread(std):
        given = {**table, "position_std": np.full(len(table["x"]), std)}
        found = Tracker(PLACES).track(given).filtered
        return np.median(found["covariance"][:, 0, 0])

    assert spread(20.0) > 10.0 * spread(2.0)


def test_updates_and_flush_give_what_track_gives(tracked):
    tracker, parts = Tracker(crossing.PARAMETERS), []
    for time in np.unique(DETECTIONS["time"]):
        now = DETECTIONS["time"] == time
        parts.append(tracker.update(time, {k: DETECTIONS[k][now] for k in ("range", "azimuth")}))
    parts.append(tracker.flush())
    for kind in ("filtered", "smoothed"):
        found = np.concatenate([getattr(part, kind) for part in parts])
        assert_same(found, getattr(tracked, kind))
    assert len(parts[-1].smoothed) > 0


def test_scans_before_the_first_detection_count():
    parameters = {"interval_s": 1.0, "radar": PLACES["radar"]}
    table, tracker = crossing.cartesian(DETECTIONS), Tracker(parameters)
    table = {name: column[table["time"] < 25.0] for name, column in table.items()}
    tracker.update(1.0)
    tracker.flush()
    parts = [tracker.update(5.0), tracker.update(9.0)]
    assert not any(len(part.filtered) for part in parts)
    for time in np.unique(table["time"]):
        now = table["time"] == time
        parts.append(tracker.update(time, {name: table[name][now] for name in ("x", "y")}))
    found = np.concatenate([part.filtered for part in [*parts, tracker.flush()]])
    empty = {"time": [5.0, 9.0], "x": [np.nan] * 2, "y": [np.nan] * 2}
    whole = {name: np.append(empty[name], column) for name, column in table.items()}
    assert_same(found, Tracker(parameters).track(whole).filtered)


def test_flush_begins_another_run():
    tracker = Tracker(crossing.PARAMETERS)
    assert len(tracker.flush().smoothed) == 0
    tracker.update(10.0, {"range": [100.0], "azimuth": [0.1]})
    tracker.flush()
    tracker.update(5.0, {"range": [100.0], "azimuth": [0.1]})
    assert not tracker.dropped


@pytest.mark.parametrize("how", ["row", "update"])
def test_scan_without_detections_counts_as_missed(how):
    one = {"range": np.full(12, 500.0), "azimuth": np.zeros(12)}
    seen, quiet = np.arange(12.0), np.arange(12.0, 30.0)
    tracker = Tracker(crossing.PARAMETERS)
    if how == "row":
        none = np.full(len(quiet), np.nan)
        table = {name: np.append(column, none) for name, column in one.items()}
        found = tracker.track({"time": np.append(seen, quiet), **table}).filtered
    else:
        parts = [
            tracker.update(time, {name: column[:1] for name, column in one.items()})
            for time in seen
        ]
        parts += [tracker.update(time) for time in quiet]
        found = np.concatenate([part.filtered for part in [*parts, tracker.flush()]])
    assert 11.0 <= found["time"].max() < 25.0
    assert not tracker.dropped


def test_amplitudes_separate_classes_where_there_are_several():
    run = simulate(seed=2)
    found = Tracker(run.parameters).track(run.detections).smoothed
    scores = evaluate(run.truth, found, cutoff=1000.0)
    assert scores["class_accuracy"] > 0.98
    assert scores["ospa"] < 75.0
    assert set(found["class"]) == {"class_0", "class_1"}


def test_turning_antenna_is_followed_by_the_plots_times(request):
    scenario = request.config.rootpath / "config" / "scenarios" / "terminal_radar.yaml"
    document = yaml_files.load(scenario)
    document["traffic"] |= {"aircraft": 8, "taxiing": 0}
    run = simulate({**document, "scans": 101}, seed=4)
    keep = ("units.azimuth_convention", "fields.time", "fields.amplitude")
    known = {f"approach.{name}": run.parameters[f"approach.{name}"] for name in keep}
    with warnings.catch_warnings():
        # Some aircraft are high and near, where slant ranges are too long.
        warnings.filterwarnings("ignore", ".*ranges over ground", UserWarning)
        tracker = Tracker({"sensors": ["approach"], **known}).fit(run.detections)
        found = tracker.track(run.detections).smoothed
    assert tracker.parameters["approach.rotation_s"] == pytest.approx(4.0, abs=0.01)
    settled = found[(found["time"] > 1030.0) & (found["time"] <= 1100.0)]
    truth = {name: run.truth[name] for name in ("time", "label", "x", "y", "vx", "vy")}
    scores = evaluate(truth, settled, cutoff=500.0, times=np.unique(settled["time"]))
    assert scores["position_detection"] > 0.9
    assert scores["position_rms"] < 100.0


def test_tracker_of_a_parameter_file_gives_what_the_bags_tracker_gives(request):
    bag = request.config.rootpath / "bags" / "one_radar"
    config = from_arguments.config_of(from_arguments.load(bag / "parameters.yaml"))
    (radar,) = config.inputs
    pipeline, smoothed, rows = new_pipeline(config), [], []
    for entry in itertools.islice(BagReader(bag).messages([radar.topic]), 20):
        report = reader_of(radar).from_cdr(entry.data, radar)
        found = report.detections
        events = pipeline.add(0, report.stamp_ns, found)
        smoothed += [each for event in events for each in event.step.smoothed]
        columns = (*found.measurement.T, found.amplitude)
        rows += [(entry.stamp_ns / 1e9, *row) for row in zip(*columns, strict=True)]
    for event in pipeline.flush():
        smoothed += event.smoothed if isinstance(event, RunEnded) else event.step.smoothed
    names = ("time", "range", "azimuth", "amplitude")
    table = Tracker(bag / "parameters.yaml").track(dict(zip(names, np.array(rows).T, strict=True)))
    position = np.concatenate([each.position for each in smoothed])
    np.testing.assert_array_equal(table.smoothed["x"], position[:, 0])
    label = np.concatenate([each.track_id for each in smoothed])
    np.testing.assert_array_equal(table.smoothed["label"], label)


def test_covariance_is_of_x_y_vx_vy(tracked):
    found = tracked.filtered
    settled = found[found["time"] > 30.0]
    deviations = np.sqrt(np.einsum("nii->ni", settled["covariance"])).mean(axis=0)
    assert (deviations[:2] > 0.5).all()
    assert (deviations[:2] < 6.0).all()
    assert (deviations[2:] < 3.0).all()
    assert evaluate(TRUTH, found, cutoff=50.0)["nees"] < 1.5


def test_unused_detections_are_reported():
    far = {**DETECTIONS, "range": np.where(DETECTIONS["time"] < 20.0, 2000.0, DETECTIONS["range"])}
    tracker = Tracker(crossing.PARAMETERS)
    with pytest.warns(UserWarning, match=r"\d+ of \d+ detections were not used: range \d+"):
        tracker.track(far)
    assert tracker.dropped["range"] == np.count_nonzero(far["range"] == 2000.0)


def test_clutter_nearer_than_min_range_is_left_out_and_starts_no_targets(tracked):
    rng, times = np.random.default_rng(3), np.unique(DETECTIONS["time"])
    clutter = {
        "time": np.repeat(times, 15),
        "range": rng.uniform(5.0, 60.0, 15 * len(times)),
        "azimuth": rng.uniform(-np.pi, np.pi, 15 * len(times)),
    }
    table = {name: np.concatenate([DETECTIONS[name], own]) for name, own in clutter.items()}
    tracker = Tracker(with_radar(min_range=60.0))
    with pytest.warns(UserWarning, match=r"detections were not used: range \d+"):
        found = tracker.track(table)
    assert tracker.dropped["range"] == np.count_nonzero(table["range"] < 60.0)
    scores = evaluate(TRUTH, found.smoothed, cutoff=50.0)
    alone = evaluate(TRUTH, tracked.smoothed, cutoff=50.0)
    assert scores["false"] == pytest.approx(alone["false"], abs=0.02)
    assert scores["ospa"] < 8.0


def test_what_must_be_known_is_named_together():
    with pytest.raises(ConfigError) as raised:
        Tracker({"radar": {"range_std": 5.0}}).track(DETECTIONS)
    assert raised.value.faults == (
        "interval_s: is missing, must be given or estimated by fit",
        "radar.azimuth_std_deg: is missing, must be given or estimated by fit",
        "radar.max_range: is missing, must be given or estimated by fit",
    )


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"radar": {"range_sdt": 5.0}}, "radar.range_sdt: unknown parameter, did you mean"),
        ({"range_std": 5.0}, "range_std: unknown parameter, did you mean radar.range_std"),
        ({"interval_s": "often"}, "interval_s: 'often' given"),
        ({"sensors": 3}, "sensors: 3 given"),
        ({"radar": {"pose": "/odometry"}}, "radar.pose: '/odometry' given, must be fixed"),
        (7, "parameters: int given, must be a mapping"),
        ("no_such.yaml", "no_such.yaml: cannot be read"),
    ],
)
def test_wrong_parameters_are_reported_at_once(parameters, said):
    with pytest.raises(ConfigError, match=said):
        Tracker(parameters)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            {"time": [1.0], "range": [2.0]},
            "azimuth: the column is missing, the columns are time, range",
        ),
        (
            {"range": [1.0], "azimuth": [2.0]},
            "time: the column is missing, .* azimuth; rename that of the times",
        ),
        ({"time": [1.0], "x": [2.0]}, "y: the column is missing, the columns are time, x"),
        (
            {"time": [1.0], "azimuth": [2.0], "x": [3.0]},
            "range: the column is missing, .*; fields.range names another one",
        ),
        (
            {"time": [1.0], "range": [1.0], "azimuth": [0.0], "radar": ["left"]},
            "radar: 'left' in row 1, must be one of radar",
        ),
    ],
)
def test_wrong_tables_are_reported(table, said):
    with pytest.raises(ValueError, match=said):
        Tracker(crossing.PARAMETERS).track(table)


def test_update_asks_which_radar_it_is_of():
    tracker = Tracker(
        {"sensors": ["a", "b"], "interval_s": 1.0}
        | {
            f"{name}.{what}": value
            for name in "ab"
            for what, value in crossing.PARAMETERS["radar"].items()
        }
    )
    with pytest.raises(ValueError, match="radar: None given, must be one of a, b"):
        tracker.update(1.0, {"range": [1.0], "azimuth": [0.0]})
    with pytest.raises(ValueError, match="radar: 'c' given, must be one of a, b"):
        tracker.update(1.0, radar="c")


def test_parameters_go_into_a_file_of_the_node(tmp_path):
    fitted = Tracker().fit(DETECTIONS)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": fitted.parameters}}))
    found = Tracker(path).track(DETECTIONS)
    assert_same(found.smoothed, fitted.track(DETECTIONS).smoothed)


def test_files_of_a_live_node_and_shipped_profiles_are_parameters(request, tmp_path):
    path = tmp_path / "live.yaml"
    of_node = {"autostart": False, "checkpoint": {"path": "/tmp/state"}, "use_sim_time": True}
    of_node |= {"outputs": ["markers"], "qos_overrides": {"/tf": {"publisher": {"depth": 3}}}}
    document = {"/radar/tracker": {"ros__parameters": {**of_node, "sensors": ["mast"]}}}
    path.write_text(yaml.safe_dump(document))
    assert Tracker(path).parameters == {"sensors": ["mast"]}
    profiles = sorted((request.config.rootpath / "config").glob("*.yaml"))
    assert len(profiles) > 5
    for profile in profiles:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            Tracker(profile)
        moving = {"autoferry": ["radar.pose"], "own_ship": ["mast.pose"]}
        assert [str(each.message).split(":")[0] for each in said] == moving.get(profile.stem, [])


@pytest.mark.parametrize(("factor", "wrong"), [(0.1, "larger"), (10.0, "smaller")])
def test_track_warns_of_innovations_that_contradict_the_noise(factor, wrong):
    usual = crossing.PARAMETERS["radar"]
    noise = {name: factor * usual[name] for name in ("range_std", "azimuth_std_deg")}
    with pytest.warns(UserWarning, match=rf"^radar: innovations are .* times {wrong} than the"):
        Tracker(with_radar(**noise)).track(DETECTIONS)


def test_radars_may_be_named_by_numbers(tracked):
    given = {**crossing.PARAMETERS, "sensors": ["7"], "7": crossing.PARAMETERS["radar"]}
    del given["radar"]
    for name in ("7", 7, 7.0):
        table = {**DETECTIONS, "radar": np.full(len(DETECTIONS["time"]), name)}
        assert_same(Tracker(given).track(table).smoothed, tracked.smoothed)


def test_track_names_a_radar_without_rows():
    given = {**crossing.PARAMETERS, "sensors": ["radar", "other"]}
    given["other"] = given["radar"]
    table = {**DETECTIONS, "radar": np.full(len(DETECTIONS["time"]), "radar")}
    with pytest.warns(UserWarning, match="^other: silent, without a row$"):
        Tracker(given).track(table)


def seen_by_two(error_deg):
    """Return what two radars detect of the usual targets; the azimuths of one have an error."""
    rng, parts = np.random.default_rng(4), []
    for name, place in (("one", 0.0), ("two", 900.0)):
        x, y = TRUTH["x"] - place, TRUTH["y"]
        azimuth = np.arctan2(y, x) + np.radians(0.5) * rng.standard_normal(len(x))
        azimuth += np.radians(error_deg if place else 0.0)
        distance = np.hypot(x, y) + 5.0 * rng.standard_normal(len(x))
        parts.append((TRUTH["time"], distance, azimuth, np.full(len(x), name)))
    columns = map(np.concatenate, zip(*parts, strict=True))
    return dict(zip(("time", "range", "azimuth", "radar"), columns, strict=True))


def test_track_warns_of_a_radar_that_does_not_agree_with_another():
    usual = {**crossing.PARAMETERS["radar"], "clutter_rate": 0.1}
    parameters = {**crossing.PARAMETERS, "sensors": ["one", "two"], "one": usual}
    del parameters["radar"]
    parameters["two"] = {**usual, "position": [900.0, 0.0]}
    expected = (
        r"^two: off the tracks that other radars see too: .*azimuths \+1.* check two\.position"
    )
    with pytest.warns(UserWarning, match=expected):
        Tracker(parameters).track(seen_by_two(2.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        Tracker(parameters).track(seen_by_two(0.0))


def test_track_of_right_parameters_does_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        Tracker(crossing.PARAMETERS).track(DETECTIONS)


def seldom_seen(seed, columns):
    """Return detections of one target at constant velocity that is missed in every second scan.

    Amid 25 false detections in a scan; `columns` are further columns with equal values. Also the
    truth.
    """
    rng, rows, truth = np.random.default_rng(seed), [], []
    for time in 0.5 * np.arange(160):
        x, y = 900.0 + 8.0 * time, -300.0 + 6.0 * time
        polar = np.column_stack([rng.uniform(30.0, 3e3, 25), rng.uniform(-np.pi, np.pi, 25)])
        if rng.random() < 0.5:
            measured = rng.normal([np.hypot(x, y), np.arctan2(y, x)], [4.0, 0.01])
            polar = np.vstack([polar, measured])
        rows += [(time, *each) for each in polar.tolist()]
        truth.append((time, 0, x, y))
    detections = dict(zip(("time", "range", "azimuth"), np.array(rows).T, strict=True))
    detections |= {name: np.full(len(rows), value) for name, value in columns.items()}
    return detections, dict(zip(("time", "label", "x", "y"), np.array(truth).T, strict=True))


@pytest.mark.parametrize(
    ("columns", "clutter"),
    [({}, {"clutter_rate": 25.0}), ({}, {}), ({"code": np.nan}, {"clutter_rate": 25.0})],
)
def test_a_target_is_found_in_clutter_that_makes_every_birth_improbable(columns, clutter):
    # 0.2 births in a scan, half of which are detected, are 0.4 % of the detections, and far less of
    # those without a reply if most targets have a transponder: less than the least probability.
    parameters = {
        "interval_s": 0.5,
        "detection_births": {"std": [10.0], "rates": [0.2], "least_probability": 0.005},
        "radar": {
            "range_std": 4.0,
            "azimuth_std_deg": 0.573,
            "max_range": 3e3,
            "clutter_max_range": 3e3,
            "detection_probability": 0.5,
            **clutter,
        },
    }
    detections, truth = seldom_seen(7, columns)
    tracks = Tracker(parameters).track(detections).smoothed
    scores = evaluate(truth, tracks, cutoff=100.0)
    assert scores["ospa"] < 60.0
    x, y = (np.interp(tracks["time"], truth["time"], truth[name]) for name in ("x", "y"))
    assert (np.hypot(tracks["x"] - x, tracks["y"] - y) < 50.0).sum() > 0.7 * len(truth["time"])


@pytest.mark.parametrize("which", ["truth", "tracks"])
def test_evaluate_names_the_table_that_lacks_a_column(which):
    tables = {"truth": TRUTH, "tracks": TRUTH}
    tables[which] = {"time": [1.0], "x": [1.0]}
    with pytest.raises(ValueError, match=rf"y: the column is missing, .*; {which} must have it"):
        evaluate(tables["truth"], tables["tracks"], cutoff=50.0)


@pytest.mark.parametrize("copied", [copy.deepcopy, pickle.dumps])
def test_a_tracker_is_copied_between_runs_and_not_in_one(copied):
    tracker = Tracker(crossing.PARAMETERS)
    copied(tracker)
    tracker.update(1.0, {"range": [1000.0], "azimuth": [0.5]})
    with pytest.raises(TypeError, match="in a run, cannot be copied"):
        copied(tracker)
