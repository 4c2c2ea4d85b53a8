# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Latitudes, longitudes and range rings on the interactive map."""

from dataclasses import replace

import numpy as np
import pytest
from records import estimates_of, plot_of, record_of, truth_of

from phd_jdtc_ros.core.types import UNKNOWN, Attributes
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report.lengths import MapScale
from phd_jdtc_ros.report.page.earth_layer import degrees, earth_layer, place_texts, ring_layer
from phd_jdtc_ros.report.page.scan_map import scan_map
from phd_jdtc_ros.report.record import RadarSite

PLANE = SystemPlane((52.3, 4.8, 5.0))
KM = MapScale("km", 1e3, 4)
METRES = MapScale("m", 1.0, 2)
VIEW = [-100.0, 100.0], [-80.0, 80.0]


def parts(trace):
    """Return the lines of a trace as arrays of shape (2, N)."""
    found, line = [], []
    for x, y in zip(trace.x, trace.y, strict=True):
        if x is None:
            found.append(np.array(line).T)
            line = []
        else:
            line.append((x, y))
    assert not line
    return found


@pytest.mark.parametrize(
    "origin",
    [(52.3, 4.8, 0.0), (-20.0, 179.9, 0.0), (0.0, 0.0, 0.0), (89.0, 0.0, 0.0), (-90.0, 0.0, 0.0)],
)
@pytest.mark.parametrize("scale", [KM, METRES])
def test_lines_are_of_equal_latitude_or_longitude_and_named_so(origin, scale):
    plane = SystemPlane(origin)
    lines, labels = earth_layer(plane, *VIEW, scale)
    assert len(parts(lines)) == len(labels.text) >= 4
    for line, text in zip(parts(lines), labels.text, strict=True):
        latitude, longitude = plane.to_geodetic(*(line * scale.metres))
        value = float(text.split("°")[0]) * (-1.0 if text[-1] in "SW" else 1.0)
        if text[-1] in "NS":
            wrong = (latitude - value) * 111e3
        else:
            apart = (longitude - value + 180.0) % 360.0 - 180.0
            wrong = apart * 111e3 * np.cos(np.radians(latitude))
        # The drawing is rounded to a metre, or to a decimetre.
        assert np.abs(wrong).max() < 1.0 * (1.0 if scale is KM else 0.1)


def test_lines_are_not_more_than_can_be_read():
    for wide in (1.0, 7.0, 33.0, 240.0, 900.0):
        lines, _ = earth_layer(PLANE, [-wide, wide], [-wide, wide], KM)
        assert 2 <= len(parts(lines)) <= 18


def test_rings_are_round_numbers_of_the_unit_about_each_radar():
    radars = (RadarSite("a", (0.0, 0.0)), RadarSite("b", (30e3, -20e3)))
    rings, labels = ring_layer(radars, *VIEW, KM)
    found = parts(rings)
    assert list(labels.text) == ["50 km", "100 km", "150 km"] * 2
    for index, ring in enumerate(found):
        x, y = (0.0, 0.0) if index < 3 else (30.0, -20.0)
        radius = np.hypot(ring[0] - x, ring[1] - y)
        np.testing.assert_allclose(radius, [50.0, 100.0, 150.0][index % 3], atol=2e-3)


def test_without_radars_there_are_no_rings():
    assert list(ring_layer((), *VIEW, KM)) == []


def test_angles_have_the_digits_of_their_step_and_a_side():
    assert degrees(50.5, 0.5, "NS") == "50.5° N"
    assert degrees(-33.25, 0.01, "NS") == "33.25° S"
    assert degrees(190.0, 10.0, "EW") == "170° W"
    assert degrees(-0.00001, 1e-4, "EW") == "0.0000° E"


def test_places_are_read_with_their_heights_above_the_earth():
    found = place_texts(PLANE, np.zeros((2, 2)), np.array([np.nan, 1000.0]))
    assert found == ["52.3000° N, 4.8000° E", "52.3000° N, 4.8000° E, height 1005 m"]


def mapped():
    plot = plot_of(1, 2)
    plot = replace(plot, height=np.full(len(plot.position), 2000.0))
    return replace(
        record_of(
            truth=(truth_of(1, 2),), plots=(plot,), filtered=(estimates_of(1, 2, 0),), smoothed=()
        ),
        radars=(RadarSite("radar_1", (0.0, 0.0), 35.0),),
        plane=PLANE,
    )


def test_map_of_a_run_on_the_earth_tells_latitudes_longitudes_and_heights():
    chart = scan_map(mapped())
    traces = {trace.name: trace for trace in chart.figure.data}
    assert {"latitude, longitude", "range rings"} <= traces.keys()
    assert traces["radars"].text == ("52.3000° N, 4.8000° E, height 40 m",)
    moving = {chart.figure.data[layer["trace"]].name: layer for layer in chart.moving}
    (texts,) = moving["detections, radar_1"]["text"]
    assert all(text.endswith("height 2005 m") for text in texts)
    told = [layer for layer in chart.moving if "text" in layer]
    # Detections, estimates and the truth.
    assert len(told) >= 3
    for layer in told:
        trace = chart.figure.data[layer["trace"]]
        assert "%{text}" in trace.hovertemplate
        assert [len(texts) for texts in layer["text"]] == [len(x) for x in layer["x"]]
    assert "latitudes and longitudes" in chart.caption
    assert not chart.figure.layout.xaxis.showgrid


def test_map_tells_heights_and_identities_of_tracks_class_by_class():
    record = mapped()
    attributes = Attributes(
        np.array([[np.nan, np.nan], [3000.0, 0.0]]),
        np.tile(np.eye(2), (2, 1, 1)),
        np.array([UNKNOWN, 0o7700]),
        np.array([0xABC, UNKNOWN]),
    )
    given = replace(record.filtered[0], attributes=attributes, track_id=np.array([4, 9]))
    truth = replace(record.truth[0], height=np.array([[100.0, 0.0], [2990.0, 0.0]]))
    chart = scan_map(replace(record, filtered=(given,), truth=(truth,)))
    told = [
        (chart.figure.data[layer["trace"]].name, layer["text"][0], layer["customdata"][0])
        for layer in chart.moving
        if "text" in layer and "customdata" in layer
    ]
    by_name = {name: (texts, details) for name, texts, details in told}
    first, second = (name for name in by_name if name.startswith("filtered"))
    truths = [name for name in by_name if name.startswith("truth")]
    assert "height" not in by_name[first][0][0]
    assert by_name[first][1][0][-1] == ", track 4, address 000ABC"
    assert by_name[second][0][0].endswith("height 3005 m")
    assert by_name[second][1][0][-1] == ", track 9, code 7700"
    assert [by_name[name][0][0].split(", ")[-1] for name in truths] == [
        "height 105 m",
        "height 2995 m",
    ]


def test_map_of_a_run_in_a_plane_tells_none():
    chart = scan_map(replace(mapped(), plane=None))
    assert "latitude, longitude" not in {trace.name for trace in chart.figure.data}
    assert not any("text" in layer for layer in chart.moving)
    assert "latitudes" not in chart.caption
