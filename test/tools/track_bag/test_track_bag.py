import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import radar_scans
from bag_content import edited, first, messages, recorded, rewrite, write

from msg_adapters.encoding import interfaces, names, stamps
from msg_adapters.incoming import detections
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.report import load

RADARS = [names.detections("radar_1"), names.detections("radar_2")]
FILTERED, SMOOTHED = names.estimates("filtered"), names.estimates("smoothed")
LEARNED = names.cardinality()
AS_SCANS = {"radar_1.message": "radar_scan", "radar_2.message": "radar_scan"}
ROOT = Path(__file__).parents[3]
BAGS = ROOT / "bags"
FILE = "/**/tracker: {ros__parameters: {sensors: [radar_1]}}\n"


def test_track_bag_writes_both_estimates_of_every_scan(short_bag, tracked):
    expected = [(1000 + 6 * scan) * 10**9 for scan in range(8)]
    for source, lags in (("filtered", [0] * 8), ("smoothed", [5, 5, 5, 4, 3, 2, 1, 0])):
        run_of = recorded(tracked, source)
        assert [e.stamp_ns for e in run_of] == expected
        assert [e.lag for e in run_of if len(e)] == [
            lag for lag, e in zip(lags, run_of, strict=True) if len(e)
        ]
        assert {cloud.header.frame_id for cloud in messages(tracked, names.estimates(source))} == {
            "map"
        }


def test_track_bag_copies_detections_and_truth_and_adds_what_was_learned(short_bag, tracked):
    copied, topics = [*RADARS, names.TRUTH], [*RADARS, names.TRUTH, FILTERED, SMOOTHED]
    source, found = BagReader(short_bag), BagReader(tracked)
    assert list(found.messages(copied)) == list(source.messages(copied))
    assert found.types == {**dict.fromkeys(topics, names.CLOUD), LEARNED: names.FIGURES}
    assert found.counts == {**dict.fromkeys(topics, 8), LEARNED: 1}


def test_track_bag_logs_everything_at_its_stamp_wherever_it_was_logged(short_bag, track, tmp_path):
    later = 3600 * 10**9  # It was recorded from a driver whose clock differs
    rewrite(short_bag, tmp_path / "late", lambda e: [(e[0], e[1], e[2] + later)])
    status, out = track(tmp_path / "late")
    assert status == 0
    for entry in BagReader(out).messages():
        assert entry.log_time_ns == stamps.of_cdr(entry.data)


def test_track_bag_writes_the_same_bytes_and_prints_scores(
    short_bag, track, tracked, same_files, capsys
):
    status, again = track(short_bag, out="again/out")
    assert status == 0
    assert same_files(again, tracked)
    printed = capsys.readouterr().out
    assert printed.startswith(f"{again}: 8 scans tracked, dropped: none\n")
    assert "means over 8 scans (OSPA: p = 2, c = 1000 m)" in printed


def test_track_bag_obeys_parameter_files(short_bag, track, tmp_path):
    text = "tracker: {ros__parameters: {lag: 0, world_frame: odom}}\n"
    (tmp_path / "p.yaml").write_text(text)
    status, out = track(short_bag, "--params-file", tmp_path / "p.yaml")
    assert status == 0
    assert {cloud.header.frame_id for cloud in messages(out, SMOOTHED)} == {"odom"}
    assert [e.lag for e in recorded(out, "smoothed")] == [0] * 8


def test_track_bag_takes_a_live_trackers_file(short_bag, track, tracked, tmp_path, same_files):
    text = """
/north/tracker:
  ros__parameters:
    use_sim_time: true
    start_type_description_service: false
    max_wait_s: 1.0
    checkpoint: {path: tracker.ckpt, every: 10}
    qos_overrides: {/radar_1/detections: {subscription: {reliability: reliable}}}
"""
    (tmp_path / "p.yaml").write_text(text)
    status, out = track(short_bag, "--params-file", tmp_path / "p.yaml")
    assert status == 0
    assert same_files(out, tracked)


def test_track_bag_without_truth_prints_no_scores(short_bag, track, tmp_path, capsys):
    status, out = track(rewrite(short_bag, tmp_path / "blind", drop=[names.TRUTH]))
    assert status == 0
    assert capsys.readouterr().out == f"{out}: 8 scans tracked, dropped: none\n"
    assert names.TRUTH not in BagReader(out).counts


def moved(entry, scan, by_s):
    """Return an entry of the bag, its stamp and log time changed from a scan on."""
    if entry[2] < (1000 + 6 * scan) * 10**9:
        return entry
    cloud = interfaces.decode(entry[1], names.CLOUD)
    stamp_ns = stamps.to_ns(cloud.header.stamp) + by_s * 10**9
    cloud.header.stamp = stamps.from_ns(stamp_ns)
    return entry[0], interfaces.encode(cloud), entry[2] + by_s * 10**9


@pytest.mark.parametrize(("gap_s", "resets"), [(84, 0), (3600, 1)])
def test_track_bag_starts_again_after_a_long_gap(short_bag, track, tmp_path, faults, gap_s, resets):
    # With the usual 6 s it is 90 s from scan to scan, the 15 intervals that are allowed.
    rewrite(short_bag, tmp_path / "gap", lambda entry: [moved(entry, 4, gap_s)])
    status, out = track(tmp_path / "gap")
    assert status == 0
    smoothed = recorded(out, "smoothed")
    assert [e.lag for e in smoothed] == (
        [3, 2, 1, 0, 3, 2, 1, 0] if resets else [5, 5, 5, 4, 3, 2, 1, 0]
    )
    assert [e.stamp_ns for e in smoothed] == [e.stamp_ns for e in recorded(out)]
    before, after = (
        {number for e in half for number in e.track_id.tolist()} - {0}
        for half in (smoothed[:4], smoothed[4:])
    )
    assert before
    assert not resets or (after and min(after) > max(before))
    jump = f"stamps jumped ahead by {gap_s + 6}.0 s, more than max_gap_scans: starting again"
    assert (jump in faults()) == bool(resets)


@pytest.mark.parametrize(("moves", "more"), [({4: -600}, ""), ({4: -600, 6: -200}, "2")])
def test_track_bag_names_stamps_that_go_back(short_bag, track, tmp_path, faults, moves, more):
    def back(entry):
        # The log time shows the order in which the messages came.
        for scan, by_s in moves.items():
            entry = (*moved(entry, scan, by_s)[:2], entry[2])
        return [entry]

    rewrite(short_bag, tmp_path / "back", back)
    status, _ = track(tmp_path / "back")
    assert status == 0
    first = max(abs(by_s) for by_s in moves.values()) - 6
    largest = f"; the largest of {more} jumps" if more else ""
    assert f"stamps jumped back by {first}.0 s: starting again{largest}" in faults()


@pytest.mark.parametrize("radar", [0, 1])
@pytest.mark.parametrize("off_s", [37, -600])
def test_track_bag_leaves_out_a_radar_whose_clock_is_wrong(
    short_bag, track, tmp_path, faults, radar, off_s
):
    def off(entry):
        entry_off = entry[0] == RADARS[radar]
        return [(*moved(entry, 4, off_s)[:2], entry[2]) if entry_off else entry]

    rewrite(short_bag, tmp_path / "off", off)
    _, out = track(tmp_path / "off")
    assert [e.stamp_ns for e in recorded(out)] == [(1000 + 6 * k) * 10**9 for k in range(8)]
    way = "ahead of" if off_s > 0 else "behind"
    named = f"{RADARS[radar]}: its stamps are {abs(off_s)}.0 s {way} those of the other sensors"
    found = "\n".join(faults())
    assert named in found
    assert "starting again" not in found


def of_scan_3(topic, log_time):
    return (topic, log_time) == (RADARS[0], 1018 * 10**9)


def rename_frame(cloud):
    cloud.header.frame_id = "elsewhere"


def drop_field(cloud):
    cloud.fields = [field for field in cloud.fields if field.name != "range"]


def shorten(cloud):
    cloud.data = bytes(cloud.data)[:-1]


def spoil_points(cloud):
    given = detections.from_msg(cloud, resolve({}).inputs[0]).detections
    bad = given.measurement.copy()
    bad[0, 0], bad[1, 0] = np.nan, -1.0
    spoiled = detections.to_msg(type(given)(bad, given.amplitude), 0, "radar_1")
    cloud.data = bytes(spoiled.data)


def no_message(entry):
    return [(entry[0], b"\0\1\0\0", entry[2])] if of_scan_3(entry[0], entry[2]) else [entry]


def twice(entry):
    return [entry, entry] if entry[0] == RADARS[0] else [entry]


@pytest.mark.parametrize(
    ("change", "dropped"),
    [
        (edited(rename_frame, of_scan_3), "frame 1"),
        (edited(drop_field, of_scan_3), "schema 1"),
        (edited(shorten, of_scan_3), "schema 1"),
        (edited(spoil_points, of_scan_3), "not_finite 1, range 1"),
        (no_message, "schema 1"),
        (twice, "duplicate 8"),
    ],
    ids=["frame", "field", "size", "points", "bytes", "duplicates"],
)
def test_track_bag_tracks_on_without_bad_parts(short_bag, track, tmp_path, capsys, change, dropped):
    rewrite(short_bag, tmp_path / "bad", change=change)
    status, out = track(tmp_path / "bad")
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{out}: 8 scans tracked, dropped: {dropped}\n")
    assert len(recorded(out, "filtered")) == len(recorded(out, "smoothed")) == 8
    assert "means over 8 scans" in printed.out
    assert status == 0


def test_track_bag_fails_where_less_than_half_of_the_detections_is_used(short_bag, track, faults):
    near = [
        word
        for radar in ("radar_1", "radar_2")
        for name in ("max_range", "clutter_max_range")
        for word in ("-p", f"{radar}.{name}:=2500.0")
    ]
    status, out = track(short_bag, *near)
    assert status == 3
    assert any(
        "detections could be used; most frequent reasons: range" in line for line in faults()
    )
    assert len(recorded(out, "smoothed")) == 8


def test_track_bag_warns_of_a_missing_amplitude_once_a_radar(short_bag, track, faults):
    status, _ = track(short_bag, "-p", "radar_2.fields.amplitude:=snr")
    assert status == 0
    *_, said = faults()
    assert said == f"{RADARS[1]}: no field 'snr'; classification does not use its amplitudes"


def test_track_bag_warns_of_azimuths_probably_in_degrees(short_bag, simulate, track, faults):
    _, bag = simulate("-p", "radar_1.units.azimuth:=deg", out="degrees")
    # A foreign recording, without parameters of its radars.
    (bag / "parameters.yaml").unlink()
    status, _ = track(bag)
    assert status == 0
    (fault,) = faults()
    count, rest = fault.removeprefix(f"{RADARS[0]}: ").split(" ", 1)
    assert int(count) > 100
    assert rest == ("azimuths beyond 2 pi rad; probably degrees, set radar_1.units.azimuth to deg")
    assert track(bag, "-p", "radar_1.units.azimuth:=deg", out="right")[0] == 0
    assert faults() == []


def test_track_bag_scores_with_another_cutoff(short_bag, track, capsys):
    assert track(short_bag, "--cutoff", "50")[0] == 0
    printed = capsys.readouterr().out
    assert "OSPA: p = 2, c = 50 m" in printed
    # No distance is larger than the cut-off.
    assert max(map(float, re.findall(r"filter +\u2502 +([0-9.]+) m", printed)[:3])) <= 50.0


@pytest.fixture
def scan_bag(short_bag, tmp_path):
    """Return the short bag with ``radar_msgs/RadarScan`` in the place of clouds."""
    inputs = {radar.topic: radar for radar in resolve({}).inputs}

    def as_scan(topic, data, log_time):
        if topic not in inputs:
            return topic, data, log_time
        report = detections.from_msg(interfaces.decode(data, names.CLOUD), inputs[topic])
        level = 20.0 * np.log10(report.detections.amplitude) - 10.0 * np.log10(2.0)
        rows = [
            (r, a, 0.0, s) for (r, a), s in zip(report.detections.measurement, level, strict=True)
        ]
        return topic, radar_scans.cdr(report.stamp_ns, inputs[topic].frame, rows), log_time

    described = {"definition": radar_scans.DEFINITION, "type_hash": "RIHS01_0"}
    topics = [Topic(topic, radar_scans.TYPE, **described) for topic in inputs]
    entries = (as_scan(e.topic, e.data, e.log_time_ns) for e in BagReader(short_bag).messages())
    return write(tmp_path / "scans", [*topics, Topic(names.TRUTH, names.CLOUD)], entries)


def test_track_bag_reads_and_copies_radar_scans_without_radar_msgs(scan_bag, tracked, track):
    given = (word for item in AS_SCANS.items() for word in ("-p", ":=".join(item)))
    status, out = track(scan_bag, *given)
    assert status == 0
    for kind in ("filtered", "smoothed"):
        of_scans, of_clouds = recorded(out, kind), recorded(tracked, kind)
        assert [e.stamp_ns for e in of_scans] == [e.stamp_ns for e in of_clouds]
        # Levels in decibels are rounded to single precision.
        for one, other in zip(of_scans, of_clouds, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=0, atol=1.0)
    source, copy = BagReader(scan_bag), BagReader(out)
    for topic in RADARS:
        assert copy.topic(topic) == source.topic(topic)
        assert [m.data for m in copy.messages([topic])] == [
            m.data for m in source.messages([topic])
        ]
    # A report shows them too.
    record = load.record(out, resolve(AS_SCANS))
    assert len(record.plots) == 16
    assert sum(len(plot.position) for plot in record.plots) > 100


@pytest.fixture(scope="module")
def one_radar(tmp_path_factory):
    """Return the first scans of the bag of one radar."""
    return first(8, BAGS / "one_radar", tmp_path_factory.mktemp("first") / "one_radar")


def test_track_bag_takes_parameters_beside_the_bag(one_radar, track, tmp_path, same_files, capsys):
    scenario = ROOT / "config" / "scenarios" / "one_radar.yaml"
    _, alone = track(one_radar, out="a/one")
    _, told = track(one_radar, "--scenario", scenario, out="b/one")
    assert same_files(alone, told)
    assert "recorded" not in capsys.readouterr().err
    # Its output is tracked and reported by one argument too.
    assert bag_parameters.read(alone)["births"] == ["north_west", "south_west"]


def test_track_bag_changes_single_parameters_of_those_beside_the_bag(one_radar, track):
    _, out = track(one_radar, "-p", "lag:=2")
    found = bag_parameters.read(out)
    assert (found["sensors"], found["lag"]) == (["radar_1"], 2)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            ("--params-file", "mine.yaml"),
            [
                "radar_1.position: [0.0, 0.0] recorded, [1000.0, 0.0] given",
            ],
        ),
        (("-p", "radar_1.clutter_rate:=5"), ["radar_1.clutter_rate: 20.0 recorded, 5.0 given"]),
    ],
    ids=["file", "assignment"],
)
def test_track_bag_reports_where_the_given_scene_is_not_the_recorded_one(
    one_radar, track, tmp_path, monkeypatch, capsys, given, expected
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(FILE)
    status, _ = track(one_radar, *given)
    said = [line for line in capsys.readouterr().err.splitlines() if "recorded" in line]
    assert status == 0
    assert said == [f"{one_radar / 'parameters.yaml'}: {line}" for line in expected]


def test_track_bag_refuses_parameters_beside_the_bag_that_are_none(track, short_bag, tmp_path):
    shutil.copytree(short_bag, tmp_path / "copy")
    (tmp_path / "copy" / "parameters.yaml").write_text("/**: {ros__parameters: {lak: 2}}\n")
    assert track(tmp_path / "copy")[0] == 2


@pytest.mark.parametrize("beside", [True, False])
def test_track_bag_reports_that_the_truth_has_more_classes(track, tmp_path, capsys, beside):
    bag = first(5, BAGS / "three_classes", tmp_path / "bag")
    if not beside:
        (bag / "parameters.yaml").unlink()
    assert track(bag)[0] == 0
    said = (
        "track_bag: the truth has class_id 2, and the tracker 2 classes" in capsys.readouterr().err
    )
    assert said is not beside


@pytest.mark.parametrize(
    ("word", "figure"),
    [("outliers", "outlier_share"), ("correlation", "detection_correlation")],
)
def test_track_bag_writes_whatever_a_radar_learns(short_bag, track, word, figure):
    status, out = track(short_bag, "-p", f"radar_1.learn:=[{word}]")
    assert status == 0
    (figures,) = messages(out, names.cardinality(), names.FIGURES)
    values = {own.key: own.value for status in figures.status for own in status.values}
    assert 0.0 <= float(values[f"radar_1.{figure}"]) < 1.0
