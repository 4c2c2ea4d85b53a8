import base64
import re
from html.parser import HTMLParser

import pytest

from phd_jdtc_ros.study.html import write_report

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
VOID = {"meta", "img", "br", "hr", "link", "input"}


def scores(first):
    return {
        "ospa": first,
        "localization": first - 20.125,
        "cardinality": 11.25,
        "cardinality_abs_error": 0.0375,
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


def page(tmp_path, summary, title="A run", figures=()):
    path = write_report(tmp_path / "deep" / "report.html", title, summary, figures)
    return path.read_text(encoding="utf-8")


def picture(tmp_path, title="Scenario", caption="Look here."):
    path = tmp_path / "scenario.png"
    path.write_bytes(PIXEL)
    return title, caption, path


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
    reader = Reader(page(tmp_path, summary, figures=[picture(tmp_path)]))

    assert reader.open == []


def test_write_report_table_has_a_row_for_each_source_and_set(tmp_path):
    rows = Reader(page(tmp_path, summary_of())).rows

    assert rows[0] == [
        "source",
        "set",
        "OSPA (m)",
        "localisation (m)",
        "cardinality (m)",
        "cardinality error (targets)",
    ]
    assert [row[:3] for row in rows[1:]] == [
        ["filtered", "all classes", "140.5"],
        ["smoothed", "all classes", "75.2"],
        ["filtered", "class 0", "150.5"],
        ["smoothed", "class 0", "85.2"],
        ["filtered", "class 1", "160.5"],
        ["smoothed", "class 1", "95.2"],
    ]
    assert rows[1][3:] == ["120.4", "11.2", "0.037"]


def test_write_report_orders_more_than_ten_classes_by_number(tmp_path):
    names = [row[1] for row in Reader(page(tmp_path, summary_of(12))).rows[2::2]]

    assert names == ["all classes", *(f"class {k}" for k in range(12))]


@pytest.mark.parametrize(
    "shown", ["46 %", "75.2 m", "99.6 %", "9.5 ms", "21.4 ms", ">80<", "p = 2, c = 1000 m"]
)
def test_write_report_shows_the_headline_numbers(tmp_path, shown):
    assert shown in page(tmp_path, summary_of())


def test_write_report_tells_a_worse_smoother(tmp_path):
    assert "12 % more" in page(tmp_path, summary_of(reduction=-0.12))


def test_write_report_shows_a_dash_for_what_is_not_known(tmp_path):
    text = page(tmp_path, nothing_known())

    assert "None" not in text
    assert text.count("<td>\N{EN DASH}</td>") == 16
    assert "there are no scores" in text


def test_write_report_loads_nothing_from_elsewhere(tmp_path):
    text = page(tmp_path, summary_of(), figures=[picture(tmp_path)])

    loaded = [value for _, name, value in Reader(text).attributes if name in ("src", "href")]
    assert len(loaded) == 1
    assert loaded[0].startswith("data:image/png;base64,")
    assert not re.search(r"https?://|url\(|@import|<script|<link", text)


def test_write_report_inlines_the_picture_with_its_caption(tmp_path):
    text = page(tmp_path, summary_of(), figures=[picture(tmp_path, "A & B", "x < y")])

    data = re.search(r'base64,([^"]+)"', text).group(1)
    assert base64.b64decode(data) == PIXEL
    assert "A &amp; B" in text
    assert "x &lt; y" in text


def test_write_report_escapes_the_title(tmp_path):
    text = page(tmp_path, summary_of(), title='<script>"$lead" & more')

    assert "<script" not in text
    assert "&lt;script&gt;&quot;$lead&quot; &amp; more" in text
