import base64
import gzip
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest
from records import SCANS, record_of
from unfolded import columns_of

from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report.page import html, words
from phd_jdtc_ros.report.page.html import POLICY, write_report
from phd_jdtc_ros.report.page.layers import Columns, degrees, earth_grid, graticule, rings
from phd_jdtc_ros.report.page.picture import picture_of
from phd_jdtc_ros.report.record import RadarSite

VOID = {"meta", "img", "br", "hr", "link", "input"}
PLANE = SystemPlane((52.3, 4.8, 5.0))
CORNER, FAR = np.array([-100e3, -80e3]), np.array([100e3, 80e3])
ORIGINS = [
    *[(52.3, 4.8, 0.0), (-20.0, 179.9, 0.0), (0.0, 0.0, 0.0)],
    *[(89.0, 0.0, 0.0), (-90.0, 0.0, 0.0)],
]


def scores(first):
    return {
        "ospa": first,
        "localization": first - 20.125,
        "cardinality": 11.25,
        "cardinality_abs_error": 0.0375,
        "gospa": None,
        "position_detection": 0.9876,
    }


def summary_of(classes=2, **changes):
    keys = ["all", *(f"class_{k}" for k in range(classes))]
    return {
        "filtered": {key: scores(140.5 + 10 * i) for i, key in enumerate(keys)},
        "smoothed": {key: scores(75.25 + 10 * i) for i, key in enumerate(keys)},
        "reduction": 0.464,
        "class_accuracy": 0.9957,
        "p": 2.0,
        "c": 1000.0,
        "scans": 80,
        "step_ms": {"median": 9.51, "p99": 21.37},
        "long_gap_s": 16.4,
        **changes,
    }


def nothing_known():
    part = dict.fromkeys(("ospa", "localization", "cardinality", "cardinality_abs_error"))
    sets = {"all": part, "class_0": part}
    return {
        "filtered": sets,
        "smoothed": sets,
        "reduction": None,
        "class_accuracy": None,
        "p": 2.0,
        "c": 1000.0,
        "scans": 0,
    }


@cache
def usual_charts():
    return charts_of(record_of())


def charts_of(record):
    return html.charts_of(record, record.evaluate(1000.0, 2.0))


def page(tmp_path, summary, title="A run", record=None, notes=()):
    drawn = usual_charts() if record is None else charts_of(record)
    path = tmp_path / "deep" / "report.html"
    assert write_report(path, title, summary, record or record_of(), drawn, notes) == path
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """Return the page of the usual summary."""
    return page(tmp_path_factory.mktemp("usual"), summary_of())


def without_library(text):
    """Return a page without the compressed parts and the picture, which have tests of their own."""
    text = re.sub(r'<script type="application/octet-stream.*?</script>', "", text, flags=re.DOTALL)
    return re.sub(r'<figure id="picture">.*?</figure>', "", text, flags=re.DOTALL)


def run_of(text):
    """Return what the page's script works on."""
    return json.loads(re.search(r'id="run">(.*?)</script>', text, re.DOTALL).group(1))


class Reader(HTMLParser):
    """Checks that tags nest, and collects attributes and table cells."""

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.rows = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *attribute) for attribute in attrs]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("th", "td"):
            self.rows[-1].append(data)


@pytest.mark.parametrize("summary", [summary_of(), summary_of(1), nothing_known(), {}])
def test_write_report_is_well_formed(tmp_path, summary):
    reader = Reader(without_library(page(tmp_path, summary, notes=["A note."])))
    assert reader.open == []


def test_write_report_table_has_a_row_for_each_source_and_set(usual):
    rows = Reader(without_library(usual)).rows
    assert rows[0] == ["set", "source", "OSPA", "localisation", "cardinality", "number error"]
    assert [row[:3] for row in rows[1:7]] == [
        ["all classes", "filtered", "140.5 m"],
        ["smoothed", "75.2 m", "55.1 m"],
        ["class 0", "filtered", "150.5 m"],
        ["smoothed", "85.2 m", "65.1 m"],
        ["class 1", "filtered", "160.5 m"],
        ["smoothed", "95.2 m", "75.1 m"],
    ]
    assert rows[1][3:] == ["120.4 m", "11.2 m", "0.037"]


def test_write_report_shows_the_headline_and_surveillance_figures(usual):
    rows = Reader(without_library(usual)).rows
    assert rows[7] == ["set", "source", "position detected"]
    assert rows[8] == ["all classes", "filtered", "98.76%"]
    assert "more than 16.4 s" in usual
    for shown in ("46 %", "75.2 m", "99.6 %", "9.5 ms", "21.4 ms", ">80<", "p = 2, c = 1000 m"):
        assert shown in usual


def test_write_report_shows_the_consistency_of_covariances(tmp_path, usual):
    summary = summary_of()
    stated = {"pairs": 240, "nees": 1.234, "nees_band_95": [0.877, 1.13], "outside_3_sigma": 0.025}
    summary["consistency"] = {"filtered": stated, "smoothed": {"pairs": 0}}
    summary["filtered"]["all"] |= {"nees": 1.234, "outside_3_sigma_age_0_4": 0.025}
    text = page(tmp_path, summary)
    rows = Reader(without_library(text)).rows
    heading = rows.index(["set", "source", "NEES", "outside age 0-4"])
    assert rows[heading + 1] == ["all classes", "filtered", "1.23", "2.5%"]
    assert "filtered, 240 pairs: 0.88 to 1.13." in text
    assert "NEES" not in usual.partition("<h2>Definitions")[0]


def test_write_report_shows_which_class_was_taken_for_which(tmp_path):
    summary = summary_of()
    summary["smoothed"]["all"]["confusion"] = [[118, 2, 0], [1, 76, 3], [4, 5, 0]]
    rows = Reader(without_library(page(tmp_path, summary))).rows
    assert rows[-4:] == [
        ["target", "class 0", "class 1", "missed"],
        ["class 0", "118", "2", "0"],
        ["class 1", "1", "76", "3"],
        ["false", "4", "5"],
    ]


def test_write_report_escapes_the_title_and_orders_classes(tmp_path):
    names = [row[0] for row in Reader(without_library(page(tmp_path, summary_of(12)))).rows[1:27:2]]
    assert names == ["all classes", *(f"class {k}" for k in range(12))]
    text = page(tmp_path, summary_of(), title='<script>"$lead" & more')
    assert "&lt;script&gt;&quot;$lead&quot; &amp; more" in text
    assert '<script>"' not in text


def test_write_report_names_the_engine_and_shows_the_papers_beside_it(tmp_path):
    live, *others = (summary_of(engine=name) for name in ("gaussian", "phd_as_printed", "phd"))
    alone = page(tmp_path, live)
    assert "<dt>engine</dt><dd>gaussian</dd>" in alone
    assert "The paper's filter" not in alone
    rows = Reader(without_library(page(tmp_path, {**live, "compared": others}))).rows
    of_engines = [row for row in rows if row and row[0].endswith(("live", "offline"))]
    cells = ["140.5 m", "75.2 m", "46 %", "99.6 %", "9.5 ms"]
    names = "phd_as_printed, offline", "phd, offline", "gaussian, live"
    assert of_engines == [[name, *cells] for name in names]


def test_write_report_without_scores_has_neither_tables_nor_dashes(tmp_path):
    text = without_library(page(tmp_path, nothing_known(), notes=["Nothing to score against."]))
    assert "None" not in text
    assert "<table" not in text
    assert "<dd>\N{EN DASH}</dd>" not in text
    assert '<p class="note">Nothing to score against.</p>' in text


def test_write_report_of_one_source_has_rows_of_it_alone(tmp_path):
    summary = {**summary_of(reduction=None), "smoothed": nothing_known()["smoothed"]}
    text = without_library(page(tmp_path, summary))
    assert "Mean OSPA distance of all targets: 140 m filtered." in text
    assert 'class="smoothed"' not in text


def test_write_report_holds_script_and_library_once_and_loads_nothing(usual):
    attributes = Reader(without_library(usual)).attributes
    assert ("meta", "content", POLICY) in attributes
    assert "default-src 'none'" in POLICY
    assert not [value for _, name, value in attributes if name in ("src", "href")]
    assert not re.search(r"https?://|url\(|@import|<link", without_library(usual))
    (library,) = re.findall(r'id="plotly">(.*?)</script>', usual)
    assert gzip.decompress(base64.b64decode(library)).decode().count("plotly.js v") == 1
    assert len(usual.encode()) < 2_500_000
    run = run_of(usual)
    assert run["times"] == [6.0 * k for k in range(SCANS)]
    assert run["unit"] == "s"
    assert [chart["name"] for chart in run["charts"]] == ["ospa", "numbers", "classes"]
    assert run["picture"]["sources"] == ["filtered", "smoothed"]


@pytest.mark.parametrize("name", ["</script><b>", "<!--<script>", "<!--", "]]>&lt;"])
def test_write_report_lets_no_name_end_or_swallow_the_script(tmp_path, name):
    record = record_of()
    evil = type(record.plots[0])(**{**vars(record.plots[0]), "radar": name})
    text = page(tmp_path, summary_of(), record=record_of(plots=(evil,)))
    assert "<" not in re.search(r'id="run">(.*?)</script>', text, re.DOTALL)[1]
    assert run_of(text)["picture"]["radars"] == [name]


def test_page_without_truth_begins_with_its_tracks_and_names_the_lack_after_them(tmp_path):
    numbered = tuple(replace(each, track_id=np.array([3, 4])) for each in record_of().smoothed)
    record = record_of(truth=(), smoothed=numbered, filtered=())
    notes = html.notes_of(record, record.evaluate(1000.0, 2.0))
    shown = page(tmp_path, nothing_known(), record=record, notes=notes)
    begin = "2 tracks in 66 s from 2023-11-14 22:13:20 UTC, at most 2 at a time."
    places = [shown.index(each) for each in (begin, 'id="picture"', "no truth in this bag")]
    assert places == sorted(places)


def lines_of(plane, corner, far):
    """Return the lines, arrays of shape (2, N) in metres, and their labels' texts."""
    columns = Columns()
    drawn = graticule(plane, corner, far, columns)
    found = columns_of(columns.text(), columns.index)
    places = np.stack([found["graticule.x"], found["graticule.y"]])
    lines = np.split(places, range(drawn["points"], places.shape[1], drawn["points"]), axis=1)
    return lines, drawn["labels"]


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
    assert ("latitudes" in words.section(header)) == (plane is not None)
