"""Recorded self-reports beside plots, from clouds in a bag to tracks and files."""

import csv
import json

import numpy as np
from bag_content import recorded, write
from harbour import DARK, KINDS, OK, configured, turns

from msg_adapters.encoding import point_cloud
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters

ORIGIN = {"world_origin": [54.0, 10.0, 0.0]}


def cloud(turn, plane):
    """Return the reports of a turn as a receiver publishes them."""
    reports = turn.reports
    latitude, longitude = plane.to_geodetic(*reports.position.T)
    north = plane.convergence(latitude, longitude)
    course = np.degrees(0.5 * np.pi + north - np.arctan2(*reports.velocity.T[::-1])) % 360.0
    columns = {
        "latitude": latitude,
        "longitude": longitude,
        "time": reports.time_ns * 1e-9,
        "speed": np.hypot(*reports.velocity.T),
        "course": course,
        "std": np.full(len(reports), 8.0),
        "address": reports.address,
        "space": reports.space.astype(np.uint8),
    }
    wide = ("latitude", "longitude", "time", "speed", "course")
    return point_cloud.to_cdr(turn.stamp_ns - 10_000_000, "", columns, wide)


def test_a_bag_of_reports_is_tracked_as_the_pipeline_tracks_them(tmp_path):
    config, scene = resolve(configured().values | ORIGIN, SystemPlane), turns(1, 150.0)
    (radar,), (receiver,) = config.inputs, config.receivers
    entries = [
        (receiver.topic, cloud(turn, config.plane), turn.stamp_ns - 10_000_000)
        for turn in scene
        if len(turn.reports)
    ]
    encode = reader_of(radar).to_cdr
    entries += [(radar.topic, encode(t.plots, t.stamp_ns, radar), t.stamp_ns) for t in scene]
    entries.sort(key=lambda entry: entry[2])
    bag = write(tmp_path / "recorded", [radar.topic, receiver.topic], entries)
    bag_parameters.write(bag / bag_parameters.NAME, config.values)
    files = {name: tmp_path / f"tracks.{name}" for name in ("csv", "geojson")}
    options = [text for name, path in files.items() for text in (f"--{name}", str(path))]
    assert run("track_bag", [str(bag), "--out", str(tmp_path / "tracked"), *options]) == 0

    found, pipeline, direct = recorded(tmp_path / "tracked"), new_pipeline(config), []
    for turn in scene:
        pipeline.add_reports(0, turn.reports)
        direct += [e.step.filtered[0] for e in pipeline.add(0, turn.stamp_ns, turn.plots)]
    ours, theirs = found[-1], direct[-1]
    # Plots and directions have single precision in messages.
    np.testing.assert_array_equal(ours.reports.address, theirs.reports.address)
    np.testing.assert_allclose(ours.position, theirs.position, atol=0.5)
    np.testing.assert_allclose(ours.reports.owned, theirs.reports.owned, atol=1e-2)
    place = scene[-1].truth
    by_kind = {
        kind: np.argmin(np.hypot(*(ours.position - place[KINDS.index(kind)]).T))
        for kind in (OK, DARK)
    }
    assert ours.reports.source_text(by_kind[OK]) == "MMSI 1001"
    assert ours.reports.dark[by_kind[DARK]] > 0.99

    rows = list(csv.DictReader(files["csv"].read_text().splitlines()))
    assert {"MMSI 1001", ""} <= {row["source"] for row in rows}
    assert any(row["reason"] == "does not transmit: never heard" for row in rows)
    properties = [
        each["properties"] for each in json.loads(files["geojson"].read_text())["features"]
    ]
    assert max(each["dark"] for each in properties) > 0.99
