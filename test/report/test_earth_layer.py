"""Latitudes, longitudes and range rings beneath the page's picture."""

from dataclasses import replace

import numpy as np
import pytest
from records import record_of
from unfolded import columns_of

from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report.page import picture_words
from phd_jdtc_ros.report.page.layers import degrees, earth_grid, graticule, rings
from phd_jdtc_ros.report.page.packing import Columns
from phd_jdtc_ros.report.page.picture import picture_of
from phd_jdtc_ros.report.record import RadarSite

PLANE = SystemPlane((52.3, 4.8, 5.0))
CORNER, FAR = np.array([-100e3, -80e3]), np.array([100e3, 80e3])
ORIGINS = [
    *[(52.3, 4.8, 0.0), (-20.0, 179.9, 0.0), (0.0, 0.0, 0.0)],
    *[(89.0, 0.0, 0.0), (-90.0, 0.0, 0.0)],
]


def lines_of(plane, corner, far):
    """Return the lines, arrays of shape (2, N) in metres, and their labels' texts."""
    columns = Columns()
    drawn = graticule(plane, corner, far, columns)
    found = columns_of(columns.text(), columns.index)
    places = np.stack([found["graticule.x"], found["graticule.y"]])
    lines = np.split(places, range(drawn["points"], places.shape[1], drawn["points"]), axis=1)
    return lines, [text for _, _, text in drawn["labels"]]


@pytest.mark.parametrize("origin", ORIGINS)
def test_lines_are_of_equal_latitude_or_longitude_and_named_so(origin):
    plane = SystemPlane(origin)
    lines, texts = lines_of(plane, CORNER, FAR)
    assert len(lines) == len(texts) >= 4
    for line, text in zip(lines, texts, strict=True):
        latitude, longitude = plane.to_geodetic(*line)
        value = float(text.split("°")[0]) * (-1.0 if text[-1] in "SW" else 1.0)
        if text[-1] in "NS":
            wrong = (latitude - value) * 111e3
        else:
            apart = (longitude - value + 180.0) % 360.0 - 180.0
            wrong = apart * 111e3 * np.cos(np.radians(latitude))
        # The drawing is rounded to a metre.
        assert np.abs(wrong).max() < 1.0


@pytest.mark.parametrize("wide", [1e3, 7e3, 33e3, 240e3, 900e3])
def test_lines_are_not_more_than_can_be_read(wide):
    lines, _ = lines_of(PLANE, np.array([-wide, -wide]), np.array([wide, wide]))
    assert 2 <= len(lines) <= 18


@pytest.mark.parametrize("origin", ORIGINS[:3])
def test_places_between_the_nodes_of_the_grid_are_read_to_some_metres(origin):
    plane, columns = SystemPlane(origin), Columns()
    grid = earth_grid(plane, CORNER, FAR, columns)
    found = columns_of(columns.text(), columns.index)
    nodes, (row, column) = grid["nodes"], (40, 17)
    for name, true in zip(
        ("latitude", "longitude"),
        plane.to_geodetic(*(grid["corner"] + np.array(grid["cell"]) * [column + 0.5, row + 0.5])),
        strict=True,
    ):
        values = found[f"earth.{name}"].reshape(nodes, nodes)[row : row + 2, column : column + 2]
        apart = (grid["degree"] * values.mean() - true + 180.0) % 360.0 - 180.0
        assert abs(apart) < 4e-5


def test_rings_are_round_numbers_about_each_radar():
    radars = (RadarSite("a", (0.0, 0.0)), RadarSite("b", (30e3, -20e3)))
    found = rings(radars, CORNER, FAR)
    assert [text for *_, text in found] == ["50 km", "100 km", "150 km"] * 2
    assert [radius for _, _, radius, _ in found] == [50e3, 100e3, 150e3] * 2
    assert [(x, y) for x, y, _, _ in found] == [(0.0, 0.0)] * 3 + [(30e3, -20e3)] * 3
    assert rings((), CORNER, FAR) == []


def test_angles_have_the_digits_of_their_step_and_a_side():
    assert degrees(50.5, 0.5, "NS") == "50.5° N"
    assert degrees(-33.25, 0.01, "NS") == "33.25° S"
    assert degrees(190.0, 10.0, "EW") == "170° W"
    assert degrees(-0.00001, 1e-4, "EW") == "0.0000° E"


@pytest.mark.parametrize("plane", [PLANE, None])
def test_picture_has_latitudes_where_the_run_is_on_the_earth(plane):
    header = picture_of(replace(record_of(), plane=plane)).header
    assert ("graticule" in header, "earth" in header) == (plane is not None,) * 2
    assert ("latitudes" in picture_words.section(header)) == (plane is not None)
