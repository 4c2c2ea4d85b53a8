from pathlib import Path

import numpy as np
import pytest
from bag_content import messages

from msg_adapters.encoding import names, stamps
from msg_adapters.incoming import detections
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "bags" / "paper_scenario"
RADARS = [names.detections("radar_1"), names.detections("radar_2")]


def test_simulate_writes_the_truth_and_radars_of_the_scenario(short_bag):
    reader = BagReader(short_bag)
    assert reader.types == dict.fromkeys([*RADARS, names.TRUTH], names.CLOUD)
    assert reader.counts == dict.fromkeys([*RADARS, names.TRUTH], 8)
    expected = [(1000 + 6 * scan) * 10**9 for scan in range(8)]
    for topic in reader.types:
        entries = list(reader.messages([topic]))
        assert [entry.log_time_ns for entry in entries] == expected
        assert [stamps.of_cdr(entry.data) for entry in entries] == expected
    found = [truth.from_msg(cloud) for cloud in messages(short_bag, names.TRUTH)]
    assert [t.track_id.tolist() for t in found] == [[1]] * 2 + [[1, 2]] * 4 + [[1]] * 2
    assert [t.class_id.tolist() for t in found] == [[0]] * 2 + [[0, 1]] * 4 + [[0]] * 2
    np.testing.assert_array_equal(found[3].state[0], [-10e3 + 18 * 36, 36, 10e3 - 18 * 44, -44, 0])
    np.testing.assert_array_equal(found[3].state[1], [-10e3 + 6 * 36, 36, -10e3 + 6 * 44, 44, 0])


def test_simulate_writes_detections_that_nothing_is_dropped_of(short_bag):
    config = resolve({})
    for radar, frame in zip(config.inputs, ("radar_1", "radar_2"), strict=True):
        found = messages(short_bag, radar.topic)
        assert {cloud.header.frame_id for cloud in found} == {frame}
        reports = [detections.from_msg(cloud, radar) for cloud in found]
        assert not any(report.dropped for report in reports)
        # 20 false detections per scan, and usually at least one of the two targets.
        assert 120 < sum(len(report.detections) for report in reports) < 220


def test_simulate_prints_what_it_wrote(simulate, capsys):
    status, out = simulate("--seed", 3)
    assert status == 0
    assert capsys.readouterr() == (f"{out}: 8 scans, 2 radars, seed 3\n", "")


@pytest.mark.parametrize("scenario", [None, ROOT / "config" / "scenarios" / "paper_scenario.yaml"])
def test_simulate_writes_the_shipped_bag_of_its_scenario_or_none(simulate, same_files, scenario):
    status, out = simulate(out="paper_scenario", scenario=scenario)
    assert status == 0
    assert same_files(out, SHIPPED)


def test_simulate_writes_the_same_bytes_for_the_same_seed_alone(simulate, same_files):
    _, one = simulate("--seed", 1, out="a/bag")
    _, again = simulate("--seed", 1, out="b/bag")
    _, other = simulate("--seed", 2, out="other")
    assert same_files(one, again)
    assert messages(one, names.TRUTH) == messages(other, names.TRUTH)
    for topic in RADARS:
        assert messages(one, topic) != messages(other, topic)


def test_simulate_takes_radars_from_the_parameters(simulate):
    _, out = simulate(
        "-p", "sensors:=[front]", "-p", "front.topic:=/front/plots", "-p", "front.frame:=mast",
        "-p", "world_frame:=odom"
    )  # fmt: skip
    assert BagReader(out).counts == {"/front/plots": 8, names.TRUTH: 8}
    assert {cloud.header.frame_id for cloud in messages(out, "/front/plots")} == {"mast"}
    assert {cloud.header.frame_id for cloud in messages(out, names.TRUTH)} == {"odom"}


OWN_LAYOUT = """
parameters:
  sensors: [own]
  own:
    message: {message}
    units: {{azimuth_convention: compass_cw, azimuth: deg, amplitude: db}}
    amplitude_offset_db: -17.0
    fields: {{range: rho, azimuth: theta, amplitude: snr}}
"""


@pytest.mark.parametrize("message", ["point_cloud", "radar_scan"])
def test_simulate_writes_the_layout_that_is_read(
    simulate, scenario_file, tmp_path, capsys, message
):
    plain, own = tmp_path / "plain.yaml", tmp_path / "own.yaml"
    plain.write_text(scenario_file.read_text() + "parameters: {sensors: [own]}\n")
    own.write_text(scenario_file.read_text() + OWN_LAYOUT.format(message=message))
    found = []
    for path in (plain, own):
        assert simulate(out=f"{path.stem}_bag", scenario=path)[0] == 0
        arguments = ["--out", str(tmp_path / f"{path.stem}_tracked"), "--scenario", str(path)]
        assert run("track_bag", [str(tmp_path / f"{path.stem}_bag"), *arguments]) == 0
        printed = capsys.readouterr()
        assert "dropped: none" in printed.out
        assert "track_bag: " not in printed.err
        clouds_of = messages(tmp_path / f"{path.stem}_tracked", names.estimates("smoothed"))
        found.append([estimates.from_msg(cloud) for cloud in clouds_of])
    assert sum(len(one) for one in found[0]) > 5
    for one, other in zip(*found, strict=True):
        # Inputs that differ in the last digit of a float give the same targets.
        np.testing.assert_allclose(one.state, other.state, rtol=0.0, atol=1.0)


def test_simulate_of_nothing_writes_empty_scans(simulate, tmp_path):
    (tmp_path / "empty.yaml").write_text("scans: 3\n")
    status, out = simulate(
        "-p", "radar_1.clutter_rate:=0", "-p", "radar_2.clutter_rate:=0",
        scenario=tmp_path / "empty.yaml"
    )  # fmt: skip
    assert status == 0
    for topic in [*RADARS, names.TRUTH]:
        assert [cloud.width for cloud in messages(out, topic)] == [0, 0, 0]


def test_simulate_writes_stamps_up_to_the_end_of_ros_time(simulate, tmp_path):
    (tmp_path / "late.yaml").write_text("start_s: 2147483000.0\nscans: 2\n")
    status, out = simulate(scenario=tmp_path / "late.yaml")
    assert status == 0
    assert [c.header.stamp.sec for c in messages(out, names.TRUTH)] == [2147483000, 2147483006]


def faults_of(capsys):
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert all(line.startswith("simulate: ") for line in lines)
    return [line.removeprefix("simulate: ") for line in lines]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, ["cannot be read: No such file or directory"]),
        (b"targets: [1,", ["is not YAML: "]),
        (b"\xff\xfe\x00", ["is not YAML: "]),
        (b"a: b: c", ["is not YAML: "]),
        # Stamps that ROS cannot hold.
        (b"start_s: 2147483648.0\nscans: 1", ["start_s: "]),
        (b"start_s: 2147483640.0\nscans: 3", ["start_s: "]),
        (b"scans: 1000000\ninterval_s: 1.0e6", ["start_s: "]),
        (
            b"scans: 0\nspeed: 1\ntargets: [{class_id: -1}]\n",
            ["scans: 0", "speed: unknown", "targets[0].class_id: -1", "targets[0].snr_db: missing"],
        ),
    ],
)
def test_simulate_lists_every_fault_of_a_scenario(simulate, tmp_path, capsys, content, expected):
    path = tmp_path / "wrong.yaml"
    if content is not None:
        path.write_bytes(content)
    status, out = simulate(scenario=path)
    assert status == 2
    found = [fault.removeprefix(f"{path}: ") for fault in faults_of(capsys)]
    for words in expected:
        assert sum(fault.startswith(words) for fault in found) == 1
    assert len(found) == (8 if len(expected) > 1 else 1)
    assert not out.exists()


def test_simulate_refuses_a_negative_seed_and_to_overwrite(simulate, tmp_path, capsys):
    status, out = simulate("--seed", -1)
    assert status == 2
    assert faults_of(capsys) == ["--seed: -1 given, must be at least 0"]
    assert not out.exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("kept")
    status, out = simulate()
    assert status == 2
    assert faults_of(capsys) == [f"{out}: already exists, a bag is not overwritten"]
    assert [path.name for path in out.iterdir()] == ["mine"]
