import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import radar_scans
from mcap.reader import make_reader
from mcap.writer import Writer
from small_bags import chunked

from msg_adapters import detections, estimates, interfaces, names, stamps
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.report import load

ROOT = Path(__file__).parents[2]
RADARS = [names.detections("radar_1"), names.detections("radar_2")]
FILTERED, SMOOTHED = names.estimates("filtered"), names.estimates("smoothed")
POSES = "geometry_msgs/msg/PoseArray"


def clouds(path, topic):
    return [
        interfaces.decode(entry.data, names.CLOUD) for entry in BagReader(path).messages([topic])
    ]


def found(path, topic):
    return [estimates.from_msg(cloud) for cloud in clouds(path, topic)]


def rewrite(source, out, change=lambda entry: [entry], types=None):
    """Write a copy of a bag with each message replaced by the result of `change`."""
    reader = BagReader(source)
    kinds = {**reader.types, **(types or {})}
    with BagWriter(out) as bag:
        for topic, kind in kinds.items():
            bag.add_topic(Topic(topic, kind))
        for entry in reader.messages():
            for topic, data, log_time in change((entry.topic, entry.data, entry.log_time_ns)):
                bag.write(topic, data, log_time)
    return out


def foreign(file, topic, kind):
    """Write an MCAP file whose topic has a type that is not installed."""
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema(kind, "ros2msg", b"float64 x\n")
        writer.register_channel(topic, "cdr", schema)
        for radar in RADARS:
            definition = interfaces.definition(names.CLOUD).encode()
            schema = writer.register_schema(names.CLOUD, "ros2msg", definition)
            if radar != topic:
                writer.register_channel(radar, "cdr", schema)
        writer.finish()
    return file


@pytest.fixture
def faults(capsys):
    """Return a function that returns the complaints on stderr; progress is not one."""

    def read():
        lines = capsys.readouterr().err.splitlines()
        assert not any("Traceback" in line for line in lines)
        return [
            line.removeprefix("track_bag: ")
            for line in lines
            if line.strip() and not line.startswith("tracking ")
        ]

    return read


def test_track_bag_writes_both_estimates_of_every_scan(short_bag, tracked):
    expected = [(1000 + 6 * scan) * 10**9 for scan in range(8)]
    for topic, lags in ((FILTERED, [0] * 8), (SMOOTHED, [5, 5, 5, 4, 3, 2, 1, 0])):
        run_of = found(tracked, topic)
        assert [e.stamp_ns for e in run_of] == expected
        assert [e.lag for e in run_of if len(e)] == [
            lag for lag, e in zip(lags, run_of, strict=True) if len(e)
        ]
        assert {cloud.header.frame_id for cloud in clouds(tracked, topic)} == {"map"}


def test_track_bag_copies_detections_and_truth_as_they_are(short_bag, tracked):
    topics = [*RADARS, names.TRUTH]
    assert list(BagReader(tracked).messages(topics)) == list(BagReader(short_bag).messages(topics))


def test_track_bag_writes_nothing_else(tracked):
    topics = [*RADARS, names.TRUTH, FILTERED, SMOOTHED]
    assert BagReader(tracked).types == dict.fromkeys(topics, names.CLOUD)
    assert BagReader(tracked).counts == dict.fromkeys(topics, 8)


def test_track_bag_logs_everything_at_its_stamp_wherever_it_was_logged(short_bag, track, tmp_path):
    later = 3600 * 10**9  # as when recorded from a driver whose clock differs
    rewrite(short_bag, tmp_path / "late", lambda e: [(e[0], e[1], e[2] + later)])
    status, out = track(tmp_path / "late")
    assert status == 0
    for entry in BagReader(out).messages():
        assert entry.log_time_ns == stamps.of_cdr(entry.data)


def test_track_bag_finds_the_targets(tracked):
    last = found(tracked, SMOOTHED)[4]
    position = last.state[:, [0, 2]]
    for target in ([-10e3 + 24 * 36, 10e3 - 24 * 44], [-10e3 + 12 * 36, -10e3 + 12 * 44]):
        assert np.hypot(*(position - target).T).min() < 1000.0


def test_track_bag_writes_the_same_bytes_every_time(short_bag, track, tracked, same_files):
    status, again = track(short_bag, out="again/out")
    assert status == 0
    assert same_files(again, tracked)


def test_track_bag_takes_a_file_as_well_as_a_directory(short_bag, track, tracked, same_files):
    status, out = track(short_bag / "short_0.mcap")
    assert status == 0
    assert same_files(out, tracked)


def test_track_bag_of_another_seed_differs(short_bag, track, tracked):
    _, out = track(short_bag, "-p", "seed:=1", "-p", "engine:=particles")
    states = [np.concatenate([e.state for e in found(path, FILTERED)]) for path in (out, tracked)]
    assert states[0].shape != states[1].shape or (states[0] != states[1]).any()


def test_track_bag_obeys_parameter_files(short_bag, track, tmp_path):
    text = "tracker: {ros__parameters: {lag: 0, world_frame: odom}}\n"
    (tmp_path / "p.yaml").write_text(text)
    status, out = track(short_bag, "--params-file", tmp_path / "p.yaml")
    assert status == 0
    assert {cloud.header.frame_id for cloud in clouds(out, SMOOTHED)} == {"odom"}
    assert [e.lag for e in found(out, SMOOTHED)] == [0] * 8


def test_track_bag_takes_the_file_of_a_live_tracker(
    short_bag, track, tracked, tmp_path, same_files
):
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


def test_track_bag_prints_what_it_tracked_and_the_scores(short_bag, track, capsys):
    status, out = track(short_bag)
    printed = capsys.readouterr().out
    assert status == 0
    assert printed.startswith(f"{out}: 8 scans tracked, dropped: none\n")
    assert "means over 8 scans (OSPA: p = 2, c = 1000 m)" in printed


def test_track_bag_without_truth_prints_no_scores(short_bag, track, tmp_path, capsys):
    with BagWriter(tmp_path / "blind") as bag:
        for topic in RADARS:
            bag.add_topic(Topic(topic, names.CLOUD))
        for entry in BagReader(short_bag).messages(RADARS):
            bag.write(entry.topic, entry.data, entry.log_time_ns)
    status, out = track(tmp_path / "blind")
    assert status == 0
    assert capsys.readouterr().out == f"{out}: 8 scans tracked, dropped: none\n"
    assert BagReader(out).counts == dict.fromkeys([*RADARS, FILTERED, SMOOTHED], 8)


def test_track_bag_of_the_order_of_radars_within_a_stamp_is_the_same(short_bag, track, tmp_path):
    held = []

    def swap(entry):
        if entry[0] != RADARS[0]:
            return [entry, *(held.pop() for _ in held[:1])] if entry[0] == RADARS[1] else [entry]
        held.append(entry)
        return []

    rewrite(short_bag, tmp_path / "swapped", swap)
    _, swapped = track(tmp_path / "swapped", out="swapped_out")
    _, usual = track(short_bag, out="usual_out")
    for topic in (FILTERED, SMOOTHED):
        assert clouds(swapped, topic) == clouds(usual, topic)
        assert len(clouds(swapped, topic)) == 8


def moved(entry, scan, by_s):
    """Return an entry of the bag, its stamp and log time changed from a scan on."""
    if entry[2] < (1000 + 6 * scan) * 10**9:
        return entry
    cloud = interfaces.decode(entry[1], names.CLOUD)
    stamp_ns = stamps.to_ns(cloud.header.stamp) + by_s * 10**9
    cloud.header.stamp = stamps.from_ns(stamp_ns)
    return entry[0], interfaces.encode(cloud), entry[2] + by_s * 10**9


@pytest.mark.parametrize(("gap_s", "resets"), [(84, 0), (3600, 1)])
def test_track_bag_starts_again_after_a_long_gap(short_bag, track, tmp_path, gap_s, resets):
    # With the usual 6 s it is 90 s from scan to scan, the 15 intervals that are allowed.
    rewrite(short_bag, tmp_path / "gap", lambda entry: [moved(entry, 4, gap_s)])
    status, out = track(tmp_path / "gap")
    assert status == 0
    smoothed = found(out, SMOOTHED)
    assert [e.lag for e in smoothed] == (
        [3, 2, 1, 0, 3, 2, 1, 0] if resets else [5, 5, 5, 4, 3, 2, 1, 0]
    )
    assert [e.stamp_ns for e in smoothed] == [e.stamp_ns for e in found(out, FILTERED)]
    before, after = (
        {number for e in half for number in e.track_id.tolist()} - {0}
        for half in (smoothed[:4], smoothed[4:])
    )
    assert before
    assert not resets or (after and min(after) > max(before))


@pytest.mark.parametrize("engine", ["particles", "gaussian"])
def test_track_bag_of_a_radar_that_is_late_is_that_of_the_bag_in_time(
    short_bag, track, tmp_path, capsys, engine
):
    stamps_ns = sorted({entry.stamp_ns for entry in BagReader(short_bag).messages(RADARS)})
    missed, worked_in = 2, 4

    def delay(entry):
        topic, data, log_time = entry
        if (topic, log_time) == (RADARS[1], stamps_ns[missed]):
            log_time = stamps_ns[worked_in] + 1
        return [(topic, data, log_time)]

    rewrite(short_bag, tmp_path / "late", delay)
    options = *("-p", "late_reports:=rework"), *("-p", f"engine:={engine}"), *("-p", "lag:=4")
    runs = {}
    for name, bag in (("whole", short_bag), ("reworked", tmp_path / "late")):
        status, runs[name] = track(bag, *options, out=name)
        assert status == 0
        assert "dropped: none" in capsys.readouterr().out
    _, runs["dropped"] = track(
        tmp_path / "late", *options, "-p", "late_reports:=drop", out="dropped"
    )
    assert "dropped: late 1" in capsys.readouterr().out

    def data(run, topic, after):
        return {
            entry.stamp_ns: entry.data
            for entry in BagReader(runs[run]).messages([topic])
            if entry.stamp_ns > after
        }

    # What was published before the late report came is without it, and all that follows has it.
    for topic, after in ((FILTERED, stamps_ns[worked_in]), (SMOOTHED, stamps_ns[worked_in - 4])):
        whole = data("whole", topic, after)
        assert len(whole) >= 3
        assert data("reworked", topic, after) == whole
        assert data("dropped", topic, after) != whole


def edited(edit, scan=3, topic=RADARS[0]):
    """Return a change that edits one radar's cloud of one scan."""

    def change(entry):
        if entry[0] != topic or entry[2] != (1000 + 6 * scan) * 10**9:
            return [entry]
        cloud = interfaces.decode(entry[1], names.CLOUD)
        edit(cloud)
        return [(entry[0], interfaces.encode(cloud), entry[2])]

    return change


def rename_frame(cloud):
    cloud.header.frame_id = "elsewhere"


def drop_field(cloud):
    cloud.fields = [field for field in cloud.fields if field.name != "range"]


def shorten(cloud):
    cloud.data = bytes(cloud.data)[:-1]


@pytest.mark.parametrize(
    ("edit", "reason"), [(rename_frame, "frame"), (drop_field, "schema"), (shorten, "schema")]
)
def test_track_bag_tracks_on_without_a_bad_scan(short_bag, track, tmp_path, capsys, edit, reason):
    rewrite(short_bag, tmp_path / "bad", edited(edit))
    status, out = track(tmp_path / "bad")
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{out}: 8 scans tracked, dropped: {reason} 1\n")
    assert len(found(out, SMOOTHED)) == 8
    assert "means over 8 scans" in printed.out
    assert status == 0


def test_track_bag_tracks_on_without_bytes_that_are_no_message(short_bag, track, tmp_path, capsys):
    def spoil(entry):
        chosen = entry[0] == RADARS[1] and entry[2] == 1018 * 10**9
        return [(entry[0], b"\0\1\0\0", entry[2])] if chosen else [entry]

    rewrite(short_bag, tmp_path / "bad", spoil)
    status, out = track(tmp_path / "bad")
    assert "8 scans tracked, dropped: schema 1\n" in capsys.readouterr().out
    assert len(found(out, SMOOTHED)) == 8
    assert status == 0


def test_track_bag_counts_dropped_points(short_bag, track, tmp_path, capsys):
    radar = resolve({}).inputs[0]

    def spoil(cloud):
        given = detections.from_msg(cloud, radar).detections
        bad = given.measurement.copy()
        bad[0, 0], bad[1, 0] = np.nan, -1.0
        spoiled = detections.to_msg(type(given)(bad, given.amplitude), 0, "radar_1")
        cloud.data = bytes(spoiled.data)

    rewrite(short_bag, tmp_path / "bad", edited(spoil))
    status, _ = track(tmp_path / "bad")
    assert status == 0
    assert "8 scans tracked, dropped: not_finite 1, range 1\n" in capsys.readouterr().out


def test_track_bag_fails_where_less_than_half_of_the_detections_could_be_used(
    short_bag, track, faults
):
    near = [
        word
        for radar in ("radar_1", "radar_2")
        for name in ("max_range", "clutter_max_range")
        for word in ("-p", f"{radar}.{name}:=2500.0")
    ]
    status, out = track(short_bag, *near)
    assert status == 3
    assert any("detections could be used; dropped most by: range" in line for line in faults())
    assert len(found(out, SMOOTHED)) == 8


def test_track_bag_warns_of_a_missing_amplitude_once_a_radar(short_bag, track, faults):
    status, _ = track(short_bag, "-p", "radar_2.fields.amplitude:=snr")
    assert status == 0
    *_, said = faults()
    assert said == f"{RADARS[1]}: no field 'snr'; classification does not use its amplitudes"


def test_track_bag_warns_of_azimuths_in_degrees_with_the_likely_cause(
    short_bag, simulate, track, faults
):
    _, bag = simulate("-p", "radar_1.azimuth_unit:=deg", out="degrees")
    # As somebody else's recording, which says nothing of its radars.
    (bag / "parameters.yaml").unlink()
    status, _ = track(bag)
    assert status == 0
    (fault,) = faults()
    count, rest = fault.removeprefix(f"{RADARS[0]}: ").split(" ", 1)
    assert int(count) > 100
    assert rest == ("azimuths beyond 2 pi rad; probably degrees, set radar_1.azimuth_unit to deg")
    assert track(bag, "-p", "radar_1.azimuth_unit:=deg", out="right")[0] == 0
    assert faults() == []


def test_track_bag_counts_duplicates(short_bag, track, tmp_path, capsys):
    rewrite(short_bag, tmp_path / "twice", lambda e: [e, e] if e[0] == RADARS[0] else [e])
    status, out = track(tmp_path / "twice")
    assert status == 0
    assert "8 scans tracked, dropped: duplicate 8\n" in capsys.readouterr().out
    assert len(found(out, FILTERED)) == 8


# -------------------------------------------------------------------------- what it refuses


def test_track_bag_of_a_missing_bag_says_so(track, tmp_path, faults):
    status, out = track(tmp_path / "none")
    assert status == 2
    assert faults() == [f"{tmp_path / 'none'}: no such bag"]
    assert not out.exists()


def test_track_bag_refuses_to_overwrite(short_bag, track, tmp_path, faults):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("kept")
    status, out = track(short_bag)
    assert status == 2
    assert faults() == [f"{out}: already exists, a bag is not overwritten"]
    assert [path.name for path in out.iterdir()] == ["mine"]


def test_track_bag_of_a_bag_without_a_radar_names_the_topic(short_bag, track, faults):
    status, out = track(short_bag, "-p", "radar_2.topic:=/other")
    assert status == 2
    _, fault = faults()
    assert fault == f"{short_bag}: /other is missing, must be {names.CLOUD}"
    assert not out.exists()


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        (RADARS[0], "radar_msgs/msg/RadarScan"),
        (names.TRUTH, POSES),
        (names.TRUTH, "radar_msgs/msg/RadarTracks"),
    ],
)
def test_track_bag_of_another_type_names_topic_and_type(track, tmp_path, faults, topic, kind):
    bag = foreign(tmp_path / "foreign.mcap", topic, kind)
    status, out = track(bag)
    assert status == 2
    assert faults() == [f"{bag}: {topic} is {kind}, must be {names.CLOUD}"]
    assert not out.exists()


@pytest.mark.parametrize("content", [b"", b"no bag", b"\0" * 500])
def test_track_bag_of_a_corrupt_bag_says_so(track, tmp_path, faults, content):
    (tmp_path / "bad.mcap").write_bytes(content)
    status, out = track(tmp_path / "bad.mcap")
    assert status == 3
    (fault,) = faults()
    assert fault.startswith(f"{tmp_path / 'bad.mcap'}: ")
    assert not out.exists()


@pytest.mark.parametrize("content", ["nothing", "bag"])
def test_track_bag_of_a_corrupt_bag_leaves_an_older_output_out_of_it(
    short_bag, track, tmp_path, capsys, content
):
    (tmp_path / "bad.mcap").write_bytes(b"no bag")
    if content == "bag":
        assert track(short_bag)[0] == 0
    else:
        (tmp_path / "out").mkdir()
    capsys.readouterr()
    status, _ = track(tmp_path / "bad.mcap")
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert status in (2, 3)  # whichever of the two faults is seen first


def test_track_bag_lists_every_fault_of_the_parameters(short_bag, track, faults):
    status, out = track(
        short_bag, "-p", "lag:=101", "-p", "engine:=best", "-p", "radar_3.yaw_deg:=0.0",
    )  # fmt: skip
    assert status == 2
    listed = faults()
    assert len(listed) == 3
    assert listed[1].startswith("lag: 101 given, must be a whole number of scans from ")
    assert listed[0].startswith("engine: 'best' given, must be one of ")
    assert listed[2] == "radar_3.yaw_deg: unknown parameter"
    assert not out.exists()


@pytest.mark.parametrize("value", ["[1,", "1" + "0" * 400, "{a: 1}", "", "1e400"])
def test_track_bag_refuses_a_value_that_is_none_in_one_line(short_bag, track, faults, value):
    status, out = track(short_bag, "-p", f"interval_s:={value}")
    assert status == 2
    (fault,) = faults()
    assert "interval_s" in fault
    assert not out.exists()


# -------------------------------------------------------------------------- damage


def assert_tracks_what_precedes(status, out, end_ns, tracked):
    assert status == 3
    expected = [e for e in found(tracked, FILTERED) if e.stamp_ns < end_ns]
    assert len(expected) >= 3
    survivors = found(out, FILTERED)
    assert len(expected) <= len(survivors) <= 8
    assert len(found(out, SMOOTHED)) == len(survivors)
    for one, other in zip(expected, survivors, strict=False):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.state, other.state)


@pytest.mark.parametrize(
    ("damage", "reason"), [("cut", ""), ("flipped", "is damaged: ")], ids=["cut", "flipped"]
)
def test_track_bag_of_a_bag_damaged_in_the_middle_tracks_what_precedes(
    short_bag, track, tracked, tmp_path, faults, damage, reason
):
    bag = chunked(tmp_path / "small", short_bag, chunk_size=2000)
    with bag.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    middle = chunks[len(chunks) // 2]
    data = bytearray(bag.read_bytes())
    at = middle.chunk_start_offset + middle.chunk_length // 2
    if damage == "cut":
        del data[at:]
    else:
        data[at] ^= 1
    bag.write_bytes(data)
    status, out = track(bag)
    (fault,) = faults()
    assert fault.startswith(f"{bag}: {reason}")
    assert_tracks_what_precedes(status, out, middle.message_start_time, tracked)


@pytest.mark.parametrize("kept", [5, 20, 1000, 0.5, 0.99])
def test_track_bag_of_a_cut_bag_ends_with_one_line_and_status_3(
    short_bag, track, tmp_path, faults, kept
):
    whole = (short_bag / "short_0.mcap").read_bytes()
    bag = tmp_path / "cut.mcap"
    bag.write_bytes(whole[: kept if kept > 1 else int(kept * len(whole))])
    status, _ = track(bag)
    assert status == 3
    (fault,) = faults()
    assert fault.startswith(f"{bag}: ")


@pytest.fixture
def scan_bag(short_bag, tmp_path):
    """Return the short bag with ``radar_msgs/RadarScan`` in the place of clouds."""
    inputs = {radar.topic: radar for radar in resolve({}).inputs}

    def as_scan(topic, data, log_time):
        if topic not in inputs:
            return [(topic, data, log_time)]
        report = detections.from_msg(interfaces.decode(data, names.CLOUD), inputs[topic])
        level = 20.0 * np.log10(report.detections.amplitude) - 10.0 * np.log10(2.0)
        rows = [
            (r, a, 0.0, s) for (r, a), s in zip(report.detections.measurement, level, strict=True)
        ]
        return [(topic, radar_scans.cdr(report.stamp_ns, inputs[topic].frame, rows), log_time)]

    out = tmp_path / "scans"
    with BagWriter(out) as bag:
        for topic in inputs:
            described = Topic(
                topic, radar_scans.TYPE, definition=radar_scans.DEFINITION, type_hash="RIHS01_0"
            )
            bag.add_topic(described)
        bag.add_topic(Topic(names.TRUTH, names.CLOUD))
        for entry in BagReader(short_bag).messages():
            for topic, data, log_time in as_scan(entry.topic, entry.data, entry.log_time_ns):
                bag.write(topic, data, log_time)
    return out


AS_SCANS = ["-p", "radar_1.message:=radar_scan", "-p", "radar_2.message:=radar_scan"]


def test_track_bag_reads_radar_scans_where_radar_msgs_is_not_installed(scan_bag, tracked, track):
    status, out = track(scan_bag, *AS_SCANS)
    assert status == 0
    for topic in (FILTERED, SMOOTHED):
        of_scans, of_clouds = found(out, topic), found(tracked, topic)
        assert [e.stamp_ns for e in of_scans] == [e.stamp_ns for e in of_clouds]
        # Levels in decibels are rounded to single precision.
        for one, other in zip(of_scans, of_clouds, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=0, atol=1.0)


def test_track_bag_copies_radar_scans_as_they_are(scan_bag, track):
    _, out = track(scan_bag, *AS_SCANS)
    source, copy = BagReader(scan_bag), BagReader(out)
    for topic in RADARS:
        assert copy.topic(topic) == source.topic(topic)
        assert [m.data for m in copy.messages([topic])] == [
            m.data for m in source.messages([topic])
        ]


def test_report_shows_the_detections_of_radar_scans(scan_bag, track):
    _, out = track(scan_bag, *AS_SCANS)
    given = {"radar_1.message": "radar_scan", "radar_2.message": "radar_scan"}
    record = load.record(out, resolve(given))
    assert len(record.plots) == 16
    assert sum(len(plot.position) for plot in record.plots) > 100


def test_track_bag_scores_with_another_cutoff(short_bag, track, capsys):
    assert track(short_bag, "--cutoff", "50")[0] == 0
    printed = capsys.readouterr().out

    assert "OSPA: p = 2, c = 50 m" in printed
    # No distance is larger than the cut-off.
    assert max(map(float, re.findall(r"filter +\u2502 +([0-9.]+) m", printed)[:3])) <= 50.0


@pytest.mark.parametrize("given", ["0", "-1", "nan", "inf", "near"])
def test_track_bag_refuses_a_cutoff_that_is_no_distance(short_bag, track, given, capsys):
    with pytest.raises(SystemExit) as caught:
        track(short_bag, f"--cutoff={given}")

    assert caught.value.code == 2
    assert f"--cutoff: {given} given, must be a number of at least" in capsys.readouterr().err


def test_track_bag_takes_the_parameters_beside_the_bag(track, tmp_path, same_files, capsys):
    bag = ROOT / "bags" / "one_radar"
    scenario = ROOT / "config" / "scenarios" / "one_radar.yaml"
    _, alone = track(bag, out="a/one")
    _, told = track(bag, "--scenario", scenario, out="b/one")
    assert same_files(alone, told)
    assert "recorded" not in capsys.readouterr().err
    # What it wrote is tracked and reported by one argument too.
    assert bag_parameters.read(alone)["births"] == ["north_west", "south_west"]


def test_track_bag_finds_a_shipped_bag_by_its_name(track, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out = track("one_radar")
    assert (status, BagReader(out).counts[names.estimates("smoothed")]) == (0, 60)


def test_track_bag_changes_single_parameters_of_those_beside_the_bag(track):
    _, out = track(ROOT / "bags" / "one_radar", "-p", "lag:=2")
    found = bag_parameters.read(out)
    assert (found["sensors"], found["lag"]) == (["radar_1"], "2")


FILE = "/**/tracker: {ros__parameters: {sensors: [radar_1]}}\n"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            ("--params-file", "mine.yaml"),
            [
                "radar_1.position: [0.0, 0.0] recorded, [1000.0, 0.0] given",
                "births: [north_west, south_west] recorded, "
                "[start_1, start_2, start_3, start_4] given",
            ],
        ),
        (("-p", "radar_1.clutter_rate:=5"), ["radar_1.clutter_rate: 20.0 recorded, 5.0 given"]),
    ],
    ids=["file", "assignment"],
)
def test_track_bag_says_where_the_given_scene_is_not_the_recorded_one(
    track, tmp_path, monkeypatch, capsys, given, expected
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(FILE)
    bag = ROOT / "bags" / "one_radar"
    status, _ = track(bag, *given)
    said = [line for line in capsys.readouterr().err.splitlines() if "recorded" in line]
    assert status == 0
    assert said == [f"{bag / 'parameters.yaml'}: {line}" for line in expected]


def test_track_bag_refuses_parameters_beside_the_bag_that_are_none(track, short_bag, tmp_path):
    shutil.copytree(short_bag, tmp_path / "copy")
    (tmp_path / "copy" / "parameters.yaml").write_text("/**: {ros__parameters: {lak: 2}}\n")
    assert track(tmp_path / "copy")[0] == 2


@pytest.mark.parametrize("beside", [True, False])
def test_track_bag_says_that_the_truth_has_more_classes(track, tmp_path, capsys, beside):
    shutil.copytree(ROOT / "bags" / "three_classes", tmp_path / "bag")
    if not beside:
        (tmp_path / "bag" / "parameters.yaml").unlink()
    assert track(tmp_path / "bag")[0] == 0
    said = (
        "track_bag: the truth has class_id 2, and the tracker 2 classes" in capsys.readouterr().err
    )
    assert said is not beside
