import json

import numpy as np
import pytest

from phd_jdtc_ros.configuration import build, zones
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.earth import SystemPlane

SQUARE = [[10.0, 54.0], [10.1, 54.0], [10.1, 54.1], [10.0, 54.1], [10.0, 54.0]]
HOLE = [[10.04, 54.04], [10.06, 54.04], [10.06, 54.06], [10.04, 54.06], [10.04, 54.04]]
BOW_TIE = [[10.0, 54.0], [10.1, 54.1], [10.1, 54.0], [10.0, 54.1], [10.0, 54.0]]
AROUND_THE_POLE = [[lon, 85.0] for lon in range(-180, 181, 60)] + [
    *([180.0, 90.0], [-180.0, 90.0], [-180.0, 85.0])
]


def written(tmp_path, *polygons, kind="guard", form="Polygon"):
    features = [
        {
            "type": "Feature",
            "properties": {"name": f"zone {index}", "kind": kind},
            "geometry": {"type": form, "coordinates": polygon},
        }
        for index, polygon in enumerate(polygons)
    ]
    path = tmp_path / "zones.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return str(path)


def inside(zone, plane, *places):
    latitude, longitude = np.array(places, dtype=float).T
    return zone.contains(np.stack(plane.to_plane(latitude, longitude), axis=1)).tolist()


def test_zones_have_their_holes_and_parts(tmp_path):
    plane = SystemPlane((54.0, 10.0, 0.0))
    other = [[[corner[0] + 1.0, corner[1]] for corner in SQUARE]]
    path = written(tmp_path, [[SQUARE, HOLE], other], form="MultiPolygon", kind="land")
    (zone,) = zones.read(path, plane)
    assert (zone.name, zone.kind) == ("zone 0", "land")
    places = (54.02, 10.02), (54.05, 10.05), (54.05, 11.05), (54.2, 10.05)
    assert inside(zone, plane, *places) == [True, False, True, False]


def test_zone_crosses_the_date_line(tmp_path):
    plane = SystemPlane((-17.5, 180.0, 0.0))
    ring = [[179.5, -18.0], [-179.5, -18.0], [-179.5, -17.0], [179.5, -17.0], [179.5, -18.0]]
    places = (-17.5, 179.9), (-17.5, -179.9), (-17.5, -178.0), (-17.5, 178.0)
    (zone,) = zones.read(written(tmp_path, [ring]), plane)
    assert inside(zone, plane, *places) == [True, True, False, False]


@pytest.mark.parametrize("begin", range(len(AROUND_THE_POLE) - 1))
def test_zone_lies_around_a_pole(tmp_path, begin):
    plane = SystemPlane((89.0, 40.0, 0.0))
    ring = [*AROUND_THE_POLE[begin:-1], *AROUND_THE_POLE[: begin + 1]]
    (zone,) = zones.read(written(tmp_path, [ring]), plane)
    assert inside(zone, plane, (90.0, 0.0), (86.0, 179.9), (84.0, 30.0)) == [True, True, False]


def test_side_along_a_parallel_stays_on_it(tmp_path):
    # A straight line in the plane would be two kilometres from the parallel here.
    plane = SystemPlane((70.0, 5.0, 0.0))
    ring = [[0.0, 70.0], [10.0, 70.0], [10.0, 71.0], [0.0, 71.0], [0.0, 70.0]]
    (zone,) = zones.read(written(tmp_path, [ring]), plane)
    assert inside(zone, plane, (70.001, 5.0), (69.999, 5.0)) == [True, False]


@pytest.mark.parametrize(
    ("polygon", "words"),
    [
        ([BOW_TIE], "self-intersection at latitude 54.0"),
        ([SQUARE, [[x + 0.05, y] for x, y in HOLE]], "zone 0: self-intersection at latitude"),
        ([SQUARE[:-1]], "not closed"),
        ([SQUARE[:3]], "at least 4"),
        ([[[10.0, 54.0], [10.1, 54.0], [10.2, 54.0], [10.0, 54.0]]], "zone 0: "),
        ([[[10.0, 54.0], [10.1, "x"], [10.2, 54.0], [10.0, 54.0]]], "zone 0: "),
        ([[[x, y + 40.0] for x, y in SQUARE]], "within 540 and 90 degrees"),
        ([[[x + 90.0, y] for x, y in SQUARE]], "farther than 2000 km"),
        ([], "zone 0: is no polygon"),
        (3, "zone 0: is no polygon"),
    ],
)
def test_faulty_polygon_is_refused_by_its_name(tmp_path, polygon, words):
    with pytest.raises(ConfigError) as caught:
        zones.read(written(tmp_path, polygon), SystemPlane((54.0, 10.0, 0.0)))
    (fault,) = caught.value.faults
    assert words in fault


def test_every_faulty_zone_is_told_and_unknown_kinds_are(tmp_path):
    with pytest.raises(ConfigError) as caught:
        zones.read(written(tmp_path, [SQUARE], [BOW_TIE], kind="no-go"), SystemPlane((54, 10, 0)))
    assert len(caught.value.faults) == 2
    assert "kind 'no-go' given, must be one of guard, exclusion, land" in caught.value.faults[0]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"features": 1}', "[" * 20_000])
def test_file_that_is_no_geojson_is_refused(tmp_path, text):
    path = tmp_path / "zones.geojson"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"zones\.geojson is no"):
        zones.read(str(path), SystemPlane((54.0, 10.0, 0.0)))


def test_zones_need_a_place_on_the_earth_and_a_file(tmp_path):
    with pytest.raises(ConfigError, match="needs world_origin"):
        build.resolve({"zones": written(tmp_path, [SQUARE])})
    origin = {"world_origin": [54.0, 10.0, 0.0]}
    with pytest.raises(ConfigError, match="No such file"):
        build.resolve({**origin, "zones": str(tmp_path / "none")}, SystemPlane)


def test_no_target_is_born_in_an_exclusion_zone(tmp_path):
    origin = {"world_origin": [54.0, 10.0, 0.0]}
    for kind, births in (("exclusion", 1), ("guard", 0), ("land", 0)):
        path = written(tmp_path, [SQUARE], kind=kind)
        config = build.resolve({**origin, "zones": path}, SystemPlane)
        assert len(config.conflicts.zones) == 1
        assert len(config.model.detection_births.excluded) == births
