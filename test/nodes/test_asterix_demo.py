"""The demo from ASTERIX to ASTERIX: live over UDP and DDS, and the shipped recording."""

import errno
import json
from pathlib import Path

import layouts
import numpy as np
import pytest
from asterix_reference import decoded, value
from bag_content import messages
from layout_panels import panels
from message_paths import values

from msg_adapters.encoding import interfaces, names, stamps
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros import resources
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.tools.asterix.writing import bridge_parameters
from phd_jdtc_ros.tools.demo import asterix as asterix_demo
from phd_jdtc_ros.tools.demo import demo
from phd_jdtc_ros.transport import sockets

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "bags" / "two_approach_radars"
SCENARIO = ROOT / "config" / "scenarios" / "two_approach_radars.yaml"
# Enough for confirmed tracks of a few aircraft.
SECONDS, AIRCRAFT = 32, 5
# Topics of layouts that are shown where there are messages.
OPTIONAL = {names.clutter_map()}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a short bag with its recording beside it."""
    directory = tmp_path_factory.mktemp("recorded")
    document = yaml_files.load(SCENARIO)
    document["scans"] = SECONDS + 1
    document["targets"] = document["targets"][:AIRCRAFT]
    path, bag = directory / "scenario.yaml", directory / "bag"
    path.write_text(json.dumps(document))
    assert run("simulate", ["--scenario", str(path), "--out", str(bag)]) == 0
    out = str(bag / asterix_demo.SHIPPED)
    assert run("asterix_bridge", [str(bag), "--plots", "--out", out]) == 0
    return bag


@pytest.fixture(scope="module")
def live(recorded, tmp_path_factory):
    out = tmp_path_factory.mktemp("live")
    assert run("demo", ["--bag", str(recorded), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def offline(recorded, tmp_path_factory):
    """Return a directory with the recording's clouds, estimates and tracks, made by files alone."""
    directory = tmp_path_factory.mktemp("offline")
    plots, tracked = str(directory / "plots"), str(directory / "tracked")
    config = from_arguments.config_of(bag_parameters.read(recorded))
    given = []
    for name, text in bridge_parameters(config).items():
        given += ["-p", f"{name}:={text}"]
    recording = str(recorded / asterix_demo.SHIPPED)
    assert run("asterix_bridge", [recording, "--out", plots, *given]) == 0
    own = ["--params-file", str(recorded / "parameters.yaml")]
    assert run("track_bag", [plots, "--out", tracked, *own]) == 0
    tracks = str(directory / asterix_demo.TRACKS)
    assert run("asterix_bridge", [tracked, "--out", tracks, *given]) == 0
    return directory


def clouds(path, topic):
    return [
        (cloud.header.stamp.sec, cloud.header.stamp.nanosec, bytes(cloud.data))
        for cloud in messages(path, topic)
    ]


@pytest.mark.live
@pytest.mark.parametrize("source", ["filtered", "smoothed"])
def test_live_estimates_of_a_recording_equal_offline_ones(live, offline, source):
    found = clouds(live / "estimates", names.estimates(source))
    assert found == clouds(offline / "tracked", names.estimates(source))
    assert len(found) >= SECONDS // 4 - 1


@pytest.mark.live
def test_live_clouds_of_a_recording_equal_offline_ones(live, offline):
    for radar in ("west", "east"):
        topic = names.detections(radar)
        found = clouds(live / "estimates", topic)
        assert found == clouds(offline / "plots", topic)
        assert len(found) > 40


@pytest.mark.live
def test_tracks_that_the_bridge_sent_are_those_of_the_files(live, offline):
    sent = (live / asterix_demo.TRACKS).read_bytes()
    assert sent == (offline / asterix_demo.TRACKS).read_bytes()
    records = decoded(sent)
    tracks = [record for record in records if record["category"] == 62]
    of_tracker = [record for record in records if record["category"] == 65]
    ends = [record for record in of_tracker if value(record, "I000", "Typ") == 2]
    assert len(tracks) > 2 * AIRCRAFT
    assert len(ends) == len(clouds(offline / "tracked", names.estimates("filtered")))
    # The latitudes are those of the scenario.
    assert all(48.0 < value(track, "I105", "Lat") < 52.0 for track in tracks)


@pytest.mark.live
def test_demo_of_a_recording_leaves_what_every_demo_leaves(live):
    metrics = json.loads((live / "metrics.json").read_text())
    assert metrics["engine"] == "gaussian"
    recorded = BagReader(live / "estimates").types
    assert names.curve("hypotheses") in recorded
    assert names.curve("particles") not in recorded
    # The first tracks are confirmed in the third revolution.
    assert metrics["scans"] >= SECONDS // 4 - 1
    assert metrics["smoothed"]["all"]["ospa"] < 700.0
    expected = {*demo.ARTEFACTS, *asterix_demo.ARTEFACTS}
    # The recording has no self-reports beside it.
    expected -= {"clutter.png", "logs/sensor_replay.log", "logs/report_bridge.log"}
    assert {str(p.relative_to(live)) for p in live.rglob("*") if p.is_file()} == expected
    page = (live / "report.html").read_text()
    assert "latitude" in page.lower()


def test_shipped_recording_and_its_bag_come_out_the_same(tmp_path):
    again = tmp_path / SHIPPED.name
    assert run("simulate", ["--scenario", str(SCENARIO), "--out", str(again)]) == 0
    out = str(again / asterix_demo.SHIPPED)
    assert run("asterix_bridge", [str(again), "--plots", "--out", out]) == 0
    written = {path.name: path.read_bytes() for path in again.iterdir()}
    assert written == {path.name: path.read_bytes() for path in SHIPPED.iterdir()}
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 1_000_000


def test_shipped_recording_is_tracked_with_the_values_of_its_profile():
    given = from_arguments.load(ROOT / "config" / "air_traffic.yaml")
    profile = resolve(given).values
    found = from_arguments.config_of(bag_parameters.read(SHIPPED)).values
    shared = [name for name in given if not name.startswith("approach.")]
    assert len(shared) > 20
    differing = {name for name in shared if found[name] != profile[name]}
    assert differing == {"sensors"}
    assert found["spawn.rate"] == profile["spawn.rate"] == 0.0


@pytest.mark.parametrize(
    ("words", "radars", "by_asterix"),
    [
        ([], ["west", "east"], True),
        (["--bag", "two_approach_radars"], ["west", "east"], True),
        (["--bag", "terminal_radar"], ["approach"], False),
    ],
)
def test_profile_of_air_traffic_plays_the_recording_unless_another_bag_is_given(
    tmp_path, monkeypatch, words, radars, by_asterix
):
    played = []

    def through(kind):
        def run_nodes(_, config, *__):
            played.append((kind, [radar.name for radar in config.inputs], config.values["engine"]))
            return False

        return run_nodes

    monkeypatch.setattr(asterix_demo, "run_nodes", through(True))
    monkeypatch.setattr(demo, "run_nodes", through(False))
    given = ["--profile", "air_traffic", "--out", str(tmp_path), *words]
    assert run("demo", given) == 1
    assert played == [(by_asterix, radars, "gaussian")]


def places(bag, config, index):
    """Return times, s, and places in the plane, m, of a radar's detections of known height."""
    radar, yaw = config.inputs[index], config.model.radars[index].yaw
    found = []
    for entry in BagReader(bag).messages([radar.topic]):
        report = reader_of(radar).from_cdr(entry.data, radar)
        seen = report.detections
        distance, azimuth = seen.measurement.T
        time = report.stamp_ns * 1e-9 + seen.time_s
        x, y = distance * np.cos(azimuth + yaw), distance * np.sin(azimuth + yaw)
        found.append(np.stack([time, x, y], axis=1)[np.isfinite(seen.height)])
    return np.concatenate(found)


@pytest.mark.live  # It shares the recording with those above
@pytest.mark.parametrize("index", [0, 1])
def test_detections_on_the_round_earth_go_to_asterix_and_back(recorded, offline, index):
    config = from_arguments.config_of(bag_parameters.read(recorded))
    before = places(recorded, config, index)
    after = places(offline / "plots", config, index)
    # The bridge has the antenna's position only from the first sectors on.
    assert len(before) - 5 <= len(after) <= len(before)
    nearest = [np.abs(before[:, 1:] - row[1:]).max(axis=1).argmin() for row in after]
    np.testing.assert_allclose(after[:, 0], before[nearest, 0], atol=0.005)
    # Ranges are of 1/256 NM, and azimuths of 360 / 2^16 degrees: 7 m at the farthest.
    np.testing.assert_allclose(after[:, 1:], before[nearest, 1:], atol=15.0)


def test_radars_send_to_one_address_where_there_are_no_groups(monkeypatch):
    group = asterix_demo.input_address()
    assert group.port > 0

    def refused(*_):
        raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr(sockets, "receiving_socket", refused)
    assert asterix_demo.input_address().host == asterix_demo.LOOPBACK


def test_bag_without_a_recording_has_none():
    assert asterix_demo.recording(resources.bag("terminal_radar")) is None
    assert asterix_demo.recording(SHIPPED) == SHIPPED / asterix_demo.SHIPPED


@pytest.fixture(scope="module")
def tracked(recorded, tmp_path_factory):
    """Return what tracking the simulated bag wrote, without a detour by ASTERIX."""
    out = tmp_path_factory.mktemp("tracked") / "bag"
    assert run("track_bag", [str(recorded), "--out", str(out)]) == 0
    return out


@pytest.fixture(params=["layout", "earth", "offline", "offline_earth"])
def shown(request, live, tracked):
    """Return the name of a layout, and a recording with all that it may show."""
    of_nodes = request.param not in layouts.VIEWS or layouts.VIEWS[request.param].live
    return request.param, BagReader(live / "estimates" if of_nodes else tracked)


def drawn(bag, series):
    """Return the points of a series that a viewer draws: those within the recording's time."""
    topic, _, path = series["value"].partition(".")
    entries = list(bag.messages([topic]))
    times = [entry.log_time_ns for entry in bag.messages([*bag.types])]
    points = []
    for entry in entries:
        message = interfaces.decode(entry.data, bag.types[topic])
        if series["timestampMethod"] == "headerStamp":
            time_ns = stamps.to_ns(message.header.stamp)
        else:
            time_ns = entry.log_time_ns
        if min(times) <= time_ns <= max(times):
            points += [float(value) for value in values(message, f".{path}")]
    return points


@pytest.mark.live
def test_layout_draws_every_plot_of_its_recording(shown):
    name, bag = shown
    plotted = [series for panel in panels(name, "Plot") for series in panel["paths"]]
    assert plotted
    for series in plotted:
        assert drawn(bag, series), series["value"]


@pytest.mark.live
def test_layout_shows_topics_that_its_recording_has(shown):
    name, bag = shown
    (scene,) = panels(name, "3D")
    for topic in scene["topics"].keys() - OPTIONAL:
        assert bag.types[topic] in {names.CLOUD, names.MARKERS}
        assert bag.counts[topic], topic
    for panel in panels(name, "DiagnosticSummary"):
        assert bag.counts[panel["topicToRender"]]
    for earth in panels(name, "map"):
        fixes = {topic for topic, kind in bag.types.items() if kind == names.FIX}
        places = [
            interfaces.decode(entry.data, names.FIX)
            for entry in bag.messages([*fixes - {*earth["disabledTopics"]}])
        ]
        assert places
        assert all(abs(fix.latitude - 50.0) < 2.0 for fix in places)
        # Viewers leave out what has no fix.
        assert all(fix.status.status >= 0 for fix in places)
