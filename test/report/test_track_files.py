"""Tracks as GeoJSON and as CSV."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from samples import estimates

from phd_jdtc_ros.core.types import COASTING, CONFIRMED, Attributes
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report import track_files

PLANE = SystemPlane((52.3, 4.8, 5.0))
NAMES = ("small", "large")


def scan(stamp_ns, numbers, shift):
    """Return estimates of tracks that go to the east at 100 m/s."""
    given = estimates(len(numbers))
    state = np.zeros((len(numbers), 5))
    state[:, 0], state[:, 1] = shift, 100.0
    return replace(
        given,
        stamp_ns=stamp_ns,
        state=state,
        track_id=np.array(numbers),
        class_id=np.full(len(numbers), 1),
        track_state=np.array([CONFIRMED] * (len(numbers) - 1) + [COASTING]),
    )


RUN = (
    scan(10_000_000_001, [7, 0, 3], 0.0),
    scan(12_000_000_001, [7], 200.0),
    scan(14_000_000_001, [7], 400.0),
)


def rows():
    return list(track_files.fixes([RUN], PLANE, NAMES))


def test_fixes_are_in_the_order_of_time_and_number_and_labelled():
    assert [(row.stamp_ns, row.number) for row in rows()] == [
        (10_000_000_001, 3),
        (10_000_000_001, 7),
        (12_000_000_001, 7),
        (14_000_000_001, 7),
    ]


def test_csv_has_a_row_for_each_fix():
    found = list(csv.DictReader(io.StringIO(track_files.to_csv(rows()))))
    assert len(found) == 4
    assert tuple(found[0]) == track_files.HEADER
    assert found[0] == {
        "time": "10.000000001",
        "number": "3",
        "x": "0.00",
        "y": "0.00",
        "vx": "100.00",
        "vy": "0.00",
        "latitude": "52.3000000",
        "longitude": "4.8000000",
        "height": "",
        "speed": "100.00",
        "course": "90.00",
        "class": "large",
        "state": "coasting",
        "code": "",
        "address": "",
        "flight_level": "",
        "run": "1",
    }
    assert float(found[3]["longitude"]) == pytest.approx(4.8 + 0.005865, abs=1e-5)


def test_geojson_has_a_line_for_each_track_and_a_point_for_a_lone_fix():
    document = json.loads(track_files.to_geojson(rows()))
    three, seven = document["features"]
    assert three["geometry"] == {"type": "Point", "coordinates": [4.8, 52.3]}
    assert seven["geometry"]["type"] == "LineString"
    assert len(seven["geometry"]["coordinates"]) == len(seven["properties"]["times"]) == 3
    assert seven["properties"]["times"] == pytest.approx([10.0, 12.0, 14.0])
    assert seven["properties"]["number"] == 7
    assert seven["properties"]["class"] == "large"
    assert not {"code", "address", "flight_level"} & seven["properties"].keys()


def test_runs_are_told_apart_by_a_column_and_a_property():
    given = list(track_files.fixes([RUN, RUN[:2]], PLANE, NAMES))
    found = list(csv.DictReader(io.StringIO(track_files.to_csv(given))))
    assert [row["run"] for row in found] == ["1"] * 4 + ["2"] * 3
    tracks = [each["properties"] for each in json.loads(track_files.to_geojson(given))["features"]]
    assert [(each["number"], each["run"]) for each in tracks] == [(3, 1), (3, 2), (7, 1), (7, 2)]


def test_heights_codes_and_addresses_are_written_where_they_are_known():
    known = Attributes(
        np.array([[2000.0, 0.0]]), np.tile(np.eye(2), (1, 1, 1)), np.array([0o42]), np.array([255])
    )
    run = (replace(RUN[1], attributes=known), replace(RUN[2], attributes=known))
    given = list(track_files.fixes([run], PLANE, NAMES))
    (row, _) = csv.DictReader(io.StringIO(track_files.to_csv(given)))
    assert (row["height"], row["code"], row["address"]) == ("2005.0", "0042", "0000FF")
    assert row["flight_level"] == "66"
    (track,) = json.loads(track_files.to_geojson(given))["features"]
    assert [len(place) for place in track["geometry"]["coordinates"]] == [3, 3]
    assert track["properties"]["code"] == "0042"
    assert track["properties"]["address"] == "0000FF"
    assert track["properties"]["flight_level"] == 66


def test_of_no_tracks_the_files_are_empty_and_valid():
    assert track_files.to_csv([]) == ",".join(track_files.HEADER) + "\n"
    assert json.loads(track_files.to_geojson([])) == {"type": "FeatureCollection", "features": []}
