"""Detections and estimates of a bag as ASTERIX."""

import itertools
import shutil

import asterix_records as made
import estimate_sets
import numpy as np
import pytest
from asterix_reference import decoded, value
from bag_content import messages, write

from msg_adapters.encoding import names
from msg_adapters.incoming import detections
from msg_adapters.targets import estimates
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types import SOURCES, Detections
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.report import load


@pytest.mark.parametrize("what", ["plots", "tracks"])
def test_bag_without_clouds_is_a_failure(tmp_path, what, capsys):
    topic = names.detections("radar_1") if what == "plots" else names.estimates("filtered")
    bag = write(tmp_path / "bag", [topic], [])
    values = {"sensors": ["radar_1"]}
    bag_parameters.write(bag / bag_parameters.NAME, from_arguments.config_of(values).values)
    words = ["--plots"] if what == "plots" else []
    assert run("asterix_bridge", [str(bag), *words, "--out", str(tmp_path / "out.ast")]) == 3
    said = capsys.readouterr().err
    assert said == f"asterix_bridge: {bag}: has no clouds, so there are no {what}\n"


@pytest.fixture(scope="module")
def by_sector(tmp_path_factory):
    """Return a simulated bag of a radar that turns, of two aircraft and three revolutions."""
    scenario = tmp_path_factory.mktemp("turning") / "scenario.yaml"
    scenario.write_text(
        """
parameters:
  sensors: [approach]
  approach:
    rotation_s: 4.0
    sectors: 16
    yaw_deg: 30.0
    fields: {time: time, amplitude: ""}
    range_std: 45.0
    azimuth_std_deg: 0.08
    max_range: 110000.0
    detection_probability: 0.99
    clutter_rate: 4.0
    clutter_max_range: 110000.0
  interval_s: 4.0
  lag_s: 8.0
  engine: gaussian
  classes: [aircraft]
  motions: [cv, ct]
  aircraft: {motions: [cv, ct], mode_transition: [0.95, 0.05, 0.1, 0.9]}
  births: []
  detection_births: {rates: [0.2], std: [100.0]}
  spawn: {rate: 0.0}
start_s: 1000.0
interval_s: 1.0
scans: 41
targets:
  - {class_id: 0, snr_db: 30.0, position: [-10000.0, 10000.0], velocity: [200.0, 50.0],
     first_scan: 0, last_scan: 40}
  - {class_id: 0, snr_db: 30.0, position: [20000.0, -5000.0], velocity: [0.0, 200.0],
     first_scan: 0, last_scan: 40}
"""
    )
    out = scenario.parent / "bag"
    assert run("simulate", ["--scenario", str(scenario), "--out", str(out)]) == 0
    return out


def test_call_signs_of_plots_are_those_of_the_tracks(tmp_path):
    """Of an aircraft with an address; they reach tracks by it, through the tracker's bag."""
    seen = {"i070": (0, 0, 0, 0, 0o1234), "i220": 0x484C3A, "i240": "KLM1023 "}
    blocks = []
    for revolution in range(12):
        for k in range(8):
            name = seen if not k else {}
            azimuth, far = 10.0 + 0.3 * revolution + 45.0 * k, 30.0 + 0.2 * revolution
            time_s = 1000.0 + 4.0 * (revolution + azimuth / 360.0)
            blocks.append(made.plots(made.plot(azimuth, time_s, far, **name)))
    recording, bag, tracked, out = (tmp_path / name for name in ("r.ast", "b", "t", "o.ast"))
    recording.write_bytes(b"".join(blocks))
    assert run("asterix_bridge", [str(recording), "--out", str(bag)]) == 0
    assert run("track_bag", [str(bag), "--out", str(tracked)]) == 0
    assert run("asterix_bridge", [str(tracked), "--out", str(out)]) == 0
    tracks = [record for record in decoded(out.read_bytes()) if record["category"] == 62]
    named = [record for record in tracks if "I245" in record]
    assert len({value(record, "I040", "TrkN") for record in tracks}) >= 8
    assert len({value(record, "I040", "TrkN") for record in named}) == 1
    for record in named:
        assert record["I245"]["TId"]["val"].strip() == "KLM1023"
        assert record["I380"]["ID"]["ACID"]["val"].strip() == "KLM1023"
        assert int(record["I380"]["ADR"]["ADR"]["val"], 16) == 0x484C3A
    run_of_tracker = load.record(tracked, from_arguments.config_of(bag_parameters.read(tracked)))
    assert [run_of_tracker.call_sign_of(each) for each in ("484C3A", "484C3B", "")] == [
        "KLM1023",
        "",
        "",
    ]


# Position and velocity of two aircraft at 1000 s.
TRUE = {1: (-10e3, 10e3, 200.0, 50.0), 2: (20e3, -5e3, 0.0, 200.0)}


@pytest.fixture(scope="module")
def with_estimates(by_sector):
    """Return a bag with estimates of two aircraft every 4 s, 2 m off in x."""
    out = by_sector.parent / "tracked"
    topics, entries = [names.estimates(source) for source in SOURCES], []
    for time_s in range(1000, 1044, 4):
        since_s = time_s - 1000.0
        true = np.array([*TRUE.values()])
        found = estimate_sets.estimates(
            estimate_sets.states(true[:, :2] + since_s * true[:, 2:] + [2.0, 0.0], true[:, 2:]),
            np.diag([900.0, 4.0, 400.0, 1.0, 1e-6]),
            stamp_ns=time_s * 10**9,
            track_id=np.array([*TRUE]),
        )
        entries += [(topic, estimates.to_msg(found, "map"), found.stamp_ns) for topic in topics]
    write(out, topics, entries)
    (out / "parameters.yaml").write_bytes((by_sector / "parameters.yaml").read_bytes())
    return out


def test_plots_that_are_too_far_for_asterix_are_left_out(tmp_path, capsys):
    bag, out = tmp_path / "bag", tmp_path / "plots.ast"
    measured = np.array([[400e3, 0.5], [474.2e3, 1.0]])
    cloud = detections.to_msg(Detections(measured, np.ones(2)), 10**12, "far")
    write(bag, ["/far/detections"], [("/far/detections", cloud, 10**12)])
    values = {"sensors": ["far"], "far.max_range": 5e5, "far.clutter_max_range": 5e5}
    bag_parameters.write(bag / bag_parameters.NAME, from_arguments.config_of(values).values)
    assert run("asterix_bridge", [str(bag), "--plots", "--out", str(out)]) == 0
    assert capsys.readouterr().out.endswith(
        "1 plot in 2 data blocks, of 1 cloud; dropped: none\n"
        "plots beyond the largest range of CAT048: 1\n"
    )
    (record,) = (each for each in decoded(out.read_bytes()) if each["category"] == 48)
    assert value(record, "I040", "RHO") * 1852.0 == pytest.approx(400e3, abs=8.0)


def test_estimates_become_tracks_that_another_decoder_reads(with_estimates, tmp_path, capsys):
    out = tmp_path / "tracks.ast"
    capsys.readouterr()
    given = ["-p", "world_origin:=[52.0, 4.5, 0.0]", "-p", "output_source:=[25, 1, 1]"]
    assert run("asterix_bridge", [str(with_estimates), "--out", str(out), *given]) == 0
    assert "dropped: none" in capsys.readouterr().out
    records = decoded(out.read_bytes())
    ends = [r for r in records if r["category"] == 65 and value(r, "I000", "Typ") == 2]
    assert [value(record, "I020", "BTN") for record in ends] == [*range(len(ends))]
    times = [value(record, "I030", "ToD") for record in ends]
    np.testing.assert_array_equal(np.diff(times), 1.0)
    tracks = [record for record in records if record["category"] == 62]
    assert {value(record, "I010", "SAC") for record in tracks} == {25}
    assert {value(record, "I080", "MON") for record in tracks} == {1}
    plane = SystemPlane([52.0, 4.5, 0.0])
    assert len(tracks) == 2 * len(ends)
    # Mean of the process noise over the motion modes of the bag's parameters.
    modes = from_arguments.config_of(bag_parameters.read(with_estimates)).model.modes
    density = sum(modes.motion_share * [motion.noise_density for motion in modes.motions])
    for record in tracks:
        x, y = value(record, "I100", "X"), value(record, "I100", "Y")
        lat, lon = value(record, "I105", "Lat"), value(record, "I105", "Lon")
        np.testing.assert_allclose(plane.to_plane(lat, lon), (x, y), atol=1.0)
        x_0, y_0, vx, vy = TRUE[value(record, "I040", "TrkN")]
        since_s = value(record, "I070", "ToT") - 1000.0
        np.testing.assert_allclose(
            (x - 2.0, y), (x_0 + vx * since_s, y_0 + vy * since_s), atol=0.26
        )
        # The deviation grows with the prediction from the latest estimates, which come every 4 s.
        ahead_s = since_s - 4.0 * min(since_s // 4.0, 10.0)
        noise = density * np.array([ahead_s**3 / 3.0, ahead_s])
        predicted = np.sqrt(np.square([np.hypot(30.0, 2.0 * ahead_s), 2.0]) + noise)
        assert value(record, "I500", "APC", "APC_X") == pytest.approx(predicted[0], abs=0.26)
        assert value(record, "I500", "ATV", "ATV_X") == pytest.approx(predicted[1], abs=0.13)


@pytest.mark.parametrize(
    ("origin", "known"), [([0.0], False), ([0.0, 0.0, 0.0], True), ([52.0, 4.5, 0.0], True)]
)
def test_tracks_about_a_guessed_place_have_no_latitudes(with_estimates, tmp_path, origin, known):
    bag, out = tmp_path / "bag", tmp_path / "tracks.ast"
    shutil.copytree(with_estimates, bag)
    given = bag_parameters.read(bag)
    given |= {"world_origin": origin, "approach.geodetic": origin}
    config = from_arguments.config_of(given)
    bag_parameters.write(bag / bag_parameters.NAME, config.values)
    assert run("asterix_bridge", [str(bag), "--out", str(out)]) == 0
    found = [record for record in decoded(out.read_bytes()) if record["category"] == 62]
    assert len(found) > 20
    assert all(("I105" in record) == known for record in found)


def test_tracks_come_with_each_cloud_where_asked(with_estimates, tmp_path):
    out = tmp_path / "tracks.ast"
    given = ["-p", "output_period_s:=0.0", "--estimates", "smoothed"]
    assert run("asterix_bridge", [str(with_estimates), "--out", str(out), *given]) == 0
    topic = names.estimates("smoothed")
    count = BagReader(with_estimates).counts[topic]
    ends = [r for r in decoded(out.read_bytes()) if value(r, "I000", "Typ") == 2]
    assert len(ends) == count


def test_tracks_of_a_recording_that_begins_again_are_written_too(with_estimates, tmp_path):
    topic = names.estimates("filtered")
    clouds = messages(with_estimates, topic)

    def tracks(begins):
        bag, out = tmp_path / f"bag_{len(begins)}", tmp_path / f"{len(begins)}.ast"
        received_ns = itertools.count(10**18, 10**9)

        def restamped():
            for begin, (index, cloud) in itertools.product(begins, enumerate(clouds)):
                cloud.header.stamp.sec = begin + index
                yield topic, cloud, next(received_ns)

        write(bag, [topic], restamped())
        assert run("asterix_bridge", [str(bag), "--out", str(out)]) == 0
        return [r for r in decoded(out.read_bytes()) if r["category"] == 62]

    once, twice = tracks((5000,)), tracks((5000, 1000))
    assert len(twice) == 2 * len(once) > 0


def test_outputs_do_not_go_on_through_a_gap_of_the_estimates(with_estimates, tmp_path):
    bag, out = tmp_path / "gap", tmp_path / "tracks.ast"
    topic = names.estimates("filtered")
    ends = messages(with_estimates, topic)[:2]
    for cloud, time_s in zip(ends, (1, 2_000_000_000), strict=True):
        cloud.header.stamp.sec = time_s
    write(bag, [topic], [(topic, cloud, cloud.header.stamp.sec * 10**9) for cloud in ends])
    assert run("asterix_bridge", [str(bag), "--out", str(out)]) == 0
    records = decoded(out.read_bytes())
    # Predicted for 10 s, then ended, and there again.
    ends = [value(record, "I000", "Typ") for record in records if record["category"] == 65]
    assert ends.count(2) == 11 + 1 + 1
    tracks = [record for record in records if record["category"] == 62]
    assert len(tracks) == 2 * (11 + 1 + 1)
    assert [value(track, "I080", "TSE") for track in tracks[-4:]] == [1, 1, 0, 0]


def test_bag_without_estimates_is_refused(by_sector, tmp_path, capsys):
    assert run("asterix_bridge", [str(by_sector), "--out", str(tmp_path / "tracks.ast")]) == 2
    assert "/tracker/filtered/estimates is missing" in capsys.readouterr().err


def test_bag_of_which_less_than_half_becomes_asterix_fails(tmp_path, capsys):
    """Estimates that are no such clouds, as of another program on the topic."""
    bag, out = tmp_path / "bag", tmp_path / "tracks.ast"
    topic = names.estimates("filtered")
    stamps_ns = [10**9 * k for k in range(3)]
    none = Detections(np.ones((1, 2)), np.ones(1))
    write(bag, [topic], [(topic, detections.to_msg(none, ns, "map"), ns) for ns in stamps_ns])
    assert run("asterix_bridge", [str(bag), "--out", str(out)]) == 3
    assert "0% of its clouds could be used; dropped: schema 3" in capsys.readouterr().err
