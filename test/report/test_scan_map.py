# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest
from records import (
    SCANS,
    estimates_of,
    plot_of,
    record_of,
    shrunk,
    stamp_ns,
    truth_of,
    without_amplitudes,
)

from msg_adapters.palette import class_colour
from phd_jdtc_ros.core.models.clutter_raster import ClutterRaster
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.report.page.scan_list import first_shown, scans_of
from phd_jdtc_ros.report.page.scan_map import scan_map
from phd_jdtc_ros.report.record import Plot

PLACE = list(PLANAR.position)


def layers(record, name):
    """Return the traces of a name, each with what moves of it."""
    chart = scan_map(record)
    moving = {layer["trace"]: layer for layer in chart.moving}
    return [
        (trace, moving.get(index))
        for index, trace in enumerate(chart.figure.data)
        if trace.name == name
    ]


def layer(record, name, mode, has):
    """Return the one moving trace of a name that is drawn so and moves in `has`."""
    found = [
        (trace, moving)
        for trace, moving in layers(record, name)
        if moving and trace.mode == mode and has in moving
    ]
    assert len(found) == 1
    return found[0]


def test_scans_are_all_stamps_of_all_parts_in_order():
    record = record_of(
        truth=(truth_of(5, 2), truth_of(0, 2)),
        plots=(plot_of(1, 2),),
        filtered=(estimates_of(3, 2, 0),),
        smoothed=(estimates_of(3, 2, 5), estimates_of(2, 2, 5)),
    )

    scans = scans_of(record)

    assert [scan.stamp_ns for scan in scans] == [stamp_ns(k) for k in (0, 1, 2, 3, 5)]
    assert list(scans[3].estimates) == ["filtered", "smoothed"]
    assert scans[3].truth is None
    assert list(scans[1].plots) == ["radar_1"]


@pytest.mark.parametrize("source", ["filtered", "smoothed"])
def test_estimates_are_where_they_were_scan_by_scan(source):
    record = record_of(2)
    trace, moving = layer(record, f"{source}, class 1", "markers", "customdata")

    for scan, found in enumerate(record.of_source(source)):
        mine = found.state[found.class_id == 1][:, PLACE] / 1e3
        np.testing.assert_allclose(np.transpose([moving["x"][scan], moving["y"][scan]]), mine)
    assert trace.marker.color == class_colour(1)
    assert trace.marker.symbol.endswith("-open") == (source == "filtered")


def test_estimates_tell_class_speed_course_weight_and_track():
    states = estimates_of(0, 1, 5)
    moving_west = np.array(states.state)
    moving_west[0, [1, 3]] = [-30.0, 0.0]
    changed = {"state": moving_west, "track_id": np.array([7])}
    record = record_of(1, smoothed=(type(states)(**{**vars(states), **changed}),))

    _, moving = layer(record, "smoothed, class 0", "markers", "customdata")

    assert moving["customdata"][0] == [[100.0, 30.0, 270.0, 1.0, ", track 7"]]


def test_ellipses_hold_95_per_cent():
    record = record_of(2)
    _, moving = layer(record, "smoothed, class 1", "lines", "x")
    found = record.smoothed[3]
    centre = found.state[1, PLACE]
    inverse = np.linalg.inv(found.covariance[1][np.ix_(PLACE, PLACE)])

    x, y = moving["x"][3], moving["y"][3]
    assert (x[-1], y[-1]) == (None, None)
    offset = 1e3 * np.transpose([x[:-1], y[:-1]]) - centre

    distance = np.einsum("ni,ij,nj->n", offset, inverse, offset)
    assert distance == pytest.approx(-2.0 * np.log(0.05), rel=0.02)


def test_the_trail_ends_with_the_scan():
    record = record_of(2, smoothed=tuple(estimates_of(k, 2, 5, 1 + k % 2) for k in range(SCANS)))
    trace, moving = layer(record, "smoothed, class 1", "markers", "upto")

    assert moving["upto"] == [k // 2 for k in range(1, SCANS + 1)]
    assert len(trace.x) == moving["upto"][-1]


def test_detections_have_places_and_amplitudes():
    record = record_of(2)
    trace, moving = layer(record, "detections, radar_1", "markers", "marker.color")

    np.testing.assert_allclose(moving["x"][4], record.plots[4].position[:, 0] / 1e3)
    np.testing.assert_allclose(
        moving["marker.color"][4], np.log10(record.plots[4].amplitude), atol=1e-3
    )
    assert moving["customdata"][4] == [200.0, 200.0, 3.8]
    assert trace.marker.coloraxis == "coloraxis"


def test_detections_without_an_amplitude_have_no_colour():
    unknown = Plot(stamp_ns(0), "radar_1", np.zeros((3, 2)), np.array([np.nan, 0.0, 10.0]))
    _, moving = layer(record_of(plots=(unknown,)), "detections, radar_1", "markers", "marker.color")

    assert moving["marker.color"][0] == [None, None, 1.0]


def test_every_radar_has_an_entry_of_its_own_in_the_legend():
    two = [Plot(stamp_ns(0), name, np.zeros((1, 2)), np.ones(1)) for name in ("radar_2", "radar_1")]
    figure = scan_map(record_of(plots=tuple(two))).figure

    shown = [trace.name for trace in figure.data if trace.showlegend is not False]
    assert [name for name in shown if name.startswith("detections")] == [
        "detections, radar_1",
        "detections, radar_2",
    ]


def test_truth_is_shown_where_it_was_with_its_number():
    record = record_of(2)
    trace, moving = layer(record, "truth, class 1", "markers", "customdata")

    assert moving["x"][7] == [pytest.approx(2.1)]
    assert moving["customdata"][7] == [2]
    assert trace.marker.color == class_colour(1)


def test_the_map_has_equal_scales_and_holds_all_targets():
    layout = scan_map(record_of(3)).figure.layout

    assert layout.yaxis.scaleanchor == "x"
    assert layout.xaxis.range[0] < 0.0 < 3.34 < layout.xaxis.range[1]
    assert layout.yaxis.range[0] < 0.0 < 4.04 < layout.yaxis.range[1]


def test_a_map_of_detections_alone_holds_them():
    layout = scan_map(record_of(truth=(), filtered=(), smoothed=())).figure.layout

    assert layout.xaxis.range[0] < -5.0 < layout.xaxis.range[1]
    assert layout.yaxis.range[0] < 4.0 < layout.yaxis.range[1]


def test_the_last_scan_with_most_targets_is_shown_first():
    record = record_of(2, truth=tuple(truth_of(k, 2 if 3 <= k <= 6 else 1) for k in range(SCANS)))

    assert first_shown(scans_of(record)) == 6
    assert first_shown([]) == 0


def test_missing_scans_of_a_part_are_empty():
    record = record_of(2, filtered=(estimates_of(2, 2, 0),))
    _, moving = layer(record, "filtered, class 0", "markers", "customdata")

    assert [len(x) for x in moving["x"]] == [int(k == 2) for k in range(SCANS)]


@pytest.mark.parametrize(("record", "unit"), [(record_of(2), "km"), (shrunk(record_of(2)), "m")])
def test_axes_and_texts_are_in_metres_where_the_map_is_short(record, unit):
    chart = scan_map(record)
    layout = chart.figure.layout
    texts = {
        trace.hovertemplate.split("<extra>")[0]
        for trace in chart.figure.data
        if trace.hovertemplate
    }
    _, moving = layer(record, "smoothed, class 1", "markers", "customdata")
    metres = 1e3 if unit == "km" else 1.0

    assert (layout.xaxis.title.text, layout.yaxis.title.text) == (f"x ({unit})", f"y ({unit})")
    assert texts
    assert all(f"}} {unit}" in text for text in texts)
    place = record.smoothed[3].position[1] / metres
    np.testing.assert_allclose([moving["x"][3][0], moving["y"][3][0]], place, atol=0.01)
    assert layout.yaxis.range[1] > place[1]


def test_map_without_amplitudes_has_no_scale_of_them():
    chart = scan_map(without_amplitudes(record_of(2)))
    trace, moving = layer(without_amplitudes(record_of(2)), "detections, radar_1", "markers", "x")

    assert chart.figure.layout.coloraxis.colorbar.title.text is None
    assert "amplitude" not in chart.caption
    assert "amplitude" not in trace.hovertemplate
    assert trace.marker.color
    assert trace.marker.coloraxis is None
    assert "marker.color" not in moving


def test_map_has_the_configured_names_of_the_classes():
    named = replace(record_of(2), class_names=("car", "van"))
    names = {trace.name for trace in scan_map(named).figure.data}

    assert {"truth, car", "smoothed, van", "filtered, car"} <= names
    assert not [name for name in names if name and "class" in name]


def test_learned_clutter_lies_beneath_everything_where_it_is():
    learned = ClutterRaster((-3000.0, 1000.0), 50.0, np.array([[0.0, 10.0], [1000.0, 0.0]]))
    chart = scan_map(replace(record_of(2), clutter=learned))
    trace = chart.figure.data[0]
    assert trace.name == "learned clutter"
    # The centres of the cells, in kilometres.
    assert (trace.x0, trace.dx, trace.y0, trace.dy) == pytest.approx((-2.975, 0.05, 1.025, 0.05))
    assert [list(row) for row in trace.z] == [[None, 1.0], [3.0, None]]
    assert "brown squares" in chart.caption
    assert "brown squares" not in scan_map(record_of(2)).caption
