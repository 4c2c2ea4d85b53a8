import struct
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from records import (
    SCANS,
    START_NS,
    estimates_of,
    record_of,
    shrunk,
    stamp_ns,
    truth_of,
    without_amplitudes,
)

from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster
from phd_jdtc_ros.report import figures, maps, style
from phd_jdtc_ros.report.figures import write_all
from phd_jdtc_ros.report.record import RadarPlots
from phd_jdtc_ros.report.style import Clock

SCORED = {"number_error", "ospa", "ospa_parts"}
EVERYTHING = {"scenario", "measurements", "trajectories"} | SCORED


def written(record, directory):
    paths = write_all(record, record.evaluate(1000.0, 2.0), directory)
    return {path.stem: path for path in paths}


def png_size(path: Path):
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", data[16:24])


@pytest.fixture
def few_pixels(monkeypatch):
    """Draw pictures whose size is not looked at with fewer pixels, which take less time."""
    for module in (style, maps):
        monkeypatch.setattr(module, "DPI", 20)


def undrawn(record, name):
    """Return a figure of a record, without pixels; None if the record lacks its data."""
    (picture,) = (each for each in figures.PICTURES if each.name == name)
    evaluation = record.evaluate(1000.0, 2.0)
    return picture.draw(record, evaluation) if picture.has_data(record, evaluation) else None


@pytest.mark.parametrize("classes", [1, 2, 3])
def test_write_all_writes_pictures_1200_pixels_wide_and_leaves_settings_alone(tmp_path, classes):
    before = dict(matplotlib.rcParams)
    pictures = written(record_of(classes), tmp_path / "new")
    assert dict(matplotlib.rcParams) == before
    assert set(pictures) == EVERYTHING
    for path in pictures.values():
        width, height = png_size(path)
        assert width == 1200
        assert 300 <= height <= 1500
        assert len(path.read_bytes()) > 5000


def empty_estimates():
    return tuple(estimates_of(k, 2, 0, 0) for k in range(SCANS))


def first_scan():
    parts = record_of()
    return {name: getattr(parts, name)[:1] for name in ("truth", "plots", "filtered", "smoothed")}


def plots_of(position, amplitude):
    return (RadarPlots(START_NS, "radar_1", np.reshape(position, (-1, 2)), np.array(amplitude)),)


UNKNOWN_AMPLITUDE = plots_of([[0.0, 0.0], [1e3, 1e3]], [np.nan, 0.0])


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize(
    ("parts", "pictures"),
    [
        ({"truth": ()}, {"measurements", "trajectories"}),
        ({"plots": ()}, EVERYTHING - {"measurements"}),
        ({"plots": plots_of([], [])}, EVERYTHING - {"measurements"}),
        ({"plots": UNKNOWN_AMPLITUDE}, EVERYTHING),
        ({"filtered": empty_estimates(), "smoothed": empty_estimates()}, EVERYTHING),
        ({"filtered": (), "smoothed": ()}, EVERYTHING - SCORED),
        ({"filtered": ()}, EVERYTHING),
        (first_scan(), EVERYTHING),
        (dict.fromkeys(("truth", "plots", "filtered", "smoothed"), ()), set()),
    ],
    ids=[
        *("no truth", "no plots", "empty plots", "unknown amplitude", "empty estimates"),
        *("no estimates", "smoothed alone", "a single scan", "nothing"),
    ],
)
def test_write_all_draws_what_the_record_has(tmp_path, parts, pictures):
    assert set(written(record_of(**parts), tmp_path)) == pictures


def test_number_error_shows_estimated_minus_true():
    record = record_of(2, smoothed=tuple(estimates_of(k, 2, 5, 1) for k in range(SCANS)))
    rows = undrawn(record, "number_error").axes
    assert [set(axes.lines[-1].get_ydata()) for axes in rows] == [{0.0}, {-1.0}]


def test_clock_counts_from_the_first_stamp_in_minutes_where_long():
    late_truth = tuple(truth_of(k, 2) for k in range(3, SCANS))
    clock = Clock.of(record_of(truth=late_truth))
    assert clock.seconds([stamp_ns(0), stamp_ns(2)]).tolist() == [0.0, 12.0]
    assert Clock(0, 7200.0).text(90.0) == "1.5 min"


@pytest.mark.parametrize(("record", "unit"), [(record_of(2), "km"), (shrunk(record_of(2)), "m")])
def test_maps_have_equal_scales_in_metres_where_they_are_short(record, unit):
    for name in ("scenario", "measurements", "trajectories"):
        axes = undrawn(record, name).axes[0]
        assert (axes.get_xlabel(), axes.get_ylabel()) == (f"x ({unit})", f"y ({unit})")
        assert axes.get_aspect() == 1.0
    low, high = axes.dataLim.intervaly
    # Two targets 2 km apart, or 20 m.
    assert high - low == pytest.approx(2.04 if unit == "km" else 20.4, rel=0.05)


def test_detections_are_purple_with_a_scale_of_known_amplitudes():
    (dots,) = undrawn(record_of(2), "measurements").axes[0].collections
    low, high = dots.cmap([0.0, 1.0])[:, :3]
    for red, green, blue in (low, high):
        assert blue > red > green
    assert low.sum() > high.sum()
    figure = undrawn(without_amplitudes(record_of(2)), "measurements")
    ((red, green, blue, _),) = figure.axes[0].collections[0].get_facecolor()
    assert len(figure.axes) == 1
    assert blue > red > green


def test_single_class_is_drawn_once_by_its_name():
    record = replace(record_of(1), class_names=("car",))
    titles = {name: [a.get_title("left") for a in undrawn(record, name).axes] for name in SCORED}
    assert titles == {
        "number_error": ["car"],
        "ospa": ["car"],
        "ospa_parts": ["car: localisation part", "car: cardinality part"],
    }


LEARNED = ClutterRaster((-3000.0, 1000.0), 50.0, np.where(np.eye(20, 40, 7) > 0.0, 200.0, 0.0))


@pytest.mark.usefixtures("few_pixels")
def test_learned_clutter_is_a_picture_of_its_own_where_it_lies(tmp_path):
    record = replace(record_of(2), clutter=LEARNED)
    assert set(written(record, tmp_path)) == {*EVERYTHING, "clutter"}
    figure = undrawn(record, "clutter")
    (image,) = figure.axes[0].images
    assert [*image.get_extent()] == [-3.0, -1.0, 1.0, 2.0]
    assert image.origin == "lower"
    shown = image.get_array()
    assert shown[3, 10] == 200.0
    assert np.ma.is_masked(shown[3, 11]) or np.isnan(shown[3, 11])


def test_a_picture_of_no_clutter_is_left_out():
    nothing = replace(LEARNED, density=np.zeros((4, 4)))
    assert undrawn(replace(record_of(2), clutter=nothing), "clutter") is None
