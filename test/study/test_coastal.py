"""The radar on the coast and on a ship: scenarios, bags, profile, and how the study scores them."""

from pathlib import Path

import numpy as np
import pytest

from msg_adapters.encoding import names
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.study.definition import KINDS, Variant
from phd_jdtc_ros.study.metrics import VALUES
from phd_jdtc_ros.study.tasks import score
from phd_jdtc_ros.study.tracker import IgnoredTargets, turning_run

ROOT = Path(__file__).parents[2]
ODOMETRY = "/own_ship/odometry"
# Parameters of a ship besides the profile: where the radar is on it, and the topic of its poses.
ABOARD = {"mast.pose": ODOMETRY, "mast.position": [8.0, 0.0], "mast.yaw_deg": -90.0}
each = pytest.mark.parametrize("name", ["coastal", "coastal_ship"])


def parameters_of(profile):
    """Return a profile's parameters with the values that learning starts from, not learned."""
    return {name: [] if name.endswith(".learn") else value for name, value in profile.items()}


def resolved(name):
    """Return a scenario and the tracker's configuration in its file."""
    document = yaml_files.load(ROOT / "config" / "scenarios" / f"{name}.yaml")
    config = resolve(from_arguments.scenario_parameters(document))
    return scenario_file.resolve(document, config.model.radars), config


@each
def test_the_profile_has_the_parameters_of_the_scenario_and_its_small_bag(name):
    profile = parameters_of(from_arguments.load(ROOT / "config" / "marine.yaml"))
    _, config = resolved(name)
    given = ABOARD if name == "coastal_ship" else {}
    found = resolve({**profile, **given})
    assert found.inputs == config.inputs
    # Parameters that the profile spells out, and that follow from others in the scenario.
    spelt_out = ("mast.topic", "mast.frame")
    expected = {key: value for key, value in config.values.items() if key not in spelt_out}
    assert {key: found.values[key] for key in expected} == expected
    found, config = resolved(name)
    bag = ROOT / "bags" / name
    assert sum(file.stat().st_size for file in bag.iterdir()) < 850_000
    counts = BagReader(bag).counts
    assert counts.pop(names.TRUTH) == found.scans
    assert counts.pop(config.inputs[0].topic) == (found.scans - 1) // 2
    poses = {} if name == "coastal" else {ODOMETRY: 2 * round(found.duration_s) + 1}
    assert counts == poses


@each
def test_most_of_what_a_bag_holds_answers_and_is_no_ship(name):
    """In world coordinates, whatever the radar's own are."""
    found, config = resolved(name)
    (radar,) = config.inputs
    points = np.concatenate([kind.points for kind in found.reflectors])
    on_reflectors, detections = 0, 0
    for entry in BagReader(ROOT / "bags" / name).messages([radar.topic]):
        report = reader_of(radar).from_cdr(entry.data, radar)
        assert not report.dropped
        elapsed_s = (report.stamp_ns - found.start_ns) * 1e-9
        for row, time_s in zip(
            report.detections.measurement, report.detections.time_s, strict=True
        ):
            own = found.radar_at(0, elapsed_s + float(time_s))
            off = np.hypot(*(points - own.to_world(row[None])[0]).T).min()
            on_reflectors += bool(off < 150.0)
            detections += 1
    assert detections > 7000
    assert 0.6 < on_reflectors / detections < 0.85


@pytest.mark.parametrize(
    ("scenario", "given", "fault"),
    [
        ("coastal_ship", "pose:=fixed", "mast.pose: fixed given, must be a topic"),
        ("coastal_ship", "pose_yaw:=false", "mast.pose_yaw: false given, must be true"),
        ("coastal", f"pose:={ODOMETRY}", "platform: must carry mast, whose pose is"),
    ],
)
def test_simulate_refuses_a_radar_that_no_platform_carries(
    scenario, given, fault, tmp_path, capsys
):
    path = ROOT / "config" / "scenarios" / f"{scenario}.yaml"
    options = ["--scenario", str(path), "--out", str(tmp_path / "x")]
    options += ["-p", f"mast.{given}"]
    assert run("simulate", options) == 2
    assert capsys.readouterr().err.startswith(f"simulate: {fault}")


def test_ships_that_are_found_late_and_estimates_on_a_quay_are_counted():
    found, _ = resolved("coastal")
    run = turning_run(found, 1, IgnoredTargets(1.0, 150.0))
    assert len(run.truth) == 100
    everything = [len(truth.track_id) for truth in run.truth]
    assert (min(everything), max(everything)) == (5, 6)
    quay = np.array([[0.0, 4170.0]])

    def points(index, truth):
        # All but the first ship from the start, that from the seventh revolution; the quay at two
        # revolutions.
        rows = np.arange(len(truth.track_id))[0 if index > 6 else 1 :]
        place = truth.position[rows] + [30.0, 0.0]
        if index in (10, 40):
            place = np.concatenate([place, quay])
        return PointSet(place, np.zeros(len(place), dtype=np.int64))

    tracks = {0: [points(index, truth) for index, truth in enumerate(run.truth)]}
    variant = Variant("any", KINDS["turning"], {}, ("coastal",), (0,))
    scored = score(run, tracks, variant, 1)
    values = dict(zip(VALUES, scored.values[0, :, 0].T, strict=True))
    assert values["late"].sum() == 1.0
    assert values["five_scans_old"].sum() == 6.0
    # In the first twenty revolutions nothing is counted.
    assert np.isnan(values["on_reflectors"][:20]).all()
    assert np.flatnonzero(values["on_reflectors"] == 1.0).tolist() == [40]
    assert np.nansum(values["on_reflectors"]) == 1.0


def test_a_ship_that_appears_behind_the_antenna_has_five_revolutions_from_the_next_one():
    """One leaves the shadow at the end of a revolution, in which no antenna can have passed it."""
    found, _ = resolved("coastal")
    run = turning_run(found, 1, IgnoredTargets(1.0, 150.0))
    appears = next(index for index, truth in enumerate(run.truth) if len(truth.track_id) == 6)
    assert appears == 23

    def late(reported):
        """Return how many are late of six, of which the last is reported from one revolution on."""
        tracks = []
        for index, truth in enumerate(run.truth):
            rows = truth.track_id < 6 if index < reported else truth.track_id <= 6
            place = truth.position[rows]
            tracks.append(PointSet(place, np.zeros(len(place), dtype=np.int64)))
        variant = Variant("any", KINDS["turning"], {}, ("coastal",), (0,))
        scored = score(run, {0: tracks}, variant, 1)
        values = dict(zip(VALUES, scored.values[0, :, 0].T, strict=True))
        assert values["five_scans_old"].sum() == 6.0
        return values["late"].sum()

    assert late(appears + 5) == 0.0
    assert late(appears + 6) == 1.0
