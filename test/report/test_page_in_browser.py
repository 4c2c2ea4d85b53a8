# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report's page in a real browser: it draws, moves, complains of nothing and loads nothing."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from headless import BROWSER, FLAGS, NAMES
from records import SCANS, record_of, stamp_ns, truth_of

from phd_jdtc_ros.report.page import charts
from phd_jdtc_ros.report.page.html import write_report
from phd_jdtc_ros.report.record import Plot

DUMPING = ("--virtual-time-budget=20000", "--enable-logging=stderr", "--dump-dom")
PHONE = 390
DARK = "--blink-settings=preferredColorScheme=0"

pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(NAMES)} is installed")


@pytest.fixture
def opened(tmp_path):
    """Return a function that opens a record's page; it returns the DOM and the console's lines."""

    def shown(address, *flags):
        profile = f"--user-data-dir={tmp_path / 'profile'}"
        done = subprocess.run(
            [BROWSER, *FLAGS, *DUMPING, *flags, profile, address],
            check=False,
            capture_output=True,
            text=True,
            timeout=120,
        )
        return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]

    def write(record=None, then=""):
        record = record_of(3) if record is None else record
        evaluation = record.evaluate(1000.0, 2.0)
        path = write_report(
            tmp_path / "report.html",
            "A run",
            evaluation.summary(),
            record,
            charts.of_record(record, evaluation),
            charts.missing(record, evaluation),
        )
        path.write_text(path.read_text().replace("</body>", f"<script>{then}</script></body>"))
        return path

    def open_page(record=None, *flags, at="", then=""):
        return shown(write(record, then).as_uri() + at, *flags)

    open_page.shown, open_page.write = shown, write
    return open_page


def part(dom, name):
    """Return the DOM of one chart."""
    return re.search(rf'<div id="{name}".*?</figure>', dom, re.DOTALL).group()


def test_page_draws_every_chart_and_complains_of_nothing(opened):
    dom, console = opened()

    assert console == []
    assert 'data-drawn="yes"' in dom
    for name in ("map", "ospa", "numbers", "classes"):
        assert '<svg class="main-svg"' in part(dom, name)
        assert 'class="trace scatter' in part(dom, name)


@pytest.mark.parametrize(
    "parts",
    [
        {"truth": ()},
        {"smoothed": ()},
        {"filtered": (), "smoothed": ()},
        {"filtered": (), "smoothed": (), "truth": (), "plots": ()},
        {"truth": (truth_of(0, 3),), "plots": (), "filtered": (), "smoothed": ()},
    ],
)
def test_page_of_a_part_draws_and_complains_of_nothing(opened, parts):
    dom, console = opened(record_of(3, **parts))

    assert console == []
    assert 'data-drawn="yes"' in dom
    assert ('<svg class="main-svg"' in dom) == (len(parts) < 4 or bool(parts["truth"]))


@pytest.mark.parametrize("name", ["<!--<script>", "</script><script>throw 1</script>"])
def test_page_of_a_radar_with_a_hostile_name_draws_its_charts(opened, name):
    record = record_of(3)
    plots = tuple(replace(plot, radar=name) for plot in record.plots)
    sites = tuple(replace(site, name=name) for site in record.radars)
    dom, console = opened(replace(record, plots=plots, radars=sites))

    assert console == []
    assert 'data-drawn="yes"' in dom
    for chart in ("map", "ospa", "numbers", "classes"):
        assert '<svg class="main-svg"' in part(dom, chart)


def test_play_goes_on_from_the_scan_asked_for_to_the_last_one(opened):
    click = (
        'setTimeout(() => { document.title = document.getElementById("shown").textContent; '
        'document.getElementById("play").click(); }, 2000);'
    )
    dom, console = opened(None, at="#scan=3", then=click)

    assert f"12.0 s, scan 3 of {SCANS}" in re.search("<title>(.*?)</title>", dom)[1]
    assert f"66.0 s, scan {SCANS} of {SCANS}" in dom
    assert ">Play<" in dom
    assert console == []


def test_a_click_on_a_time_shows_its_scan(opened):
    click = (
        'setTimeout(() => document.getElementById("ospa").emit("plotly_click", '
        "{points: [{x: 31.0}]}), 2000);"
    )
    dom, console = opened(None, then=click)

    assert f"30.0 s, scan 6 of {SCANS}" in dom
    assert console == []


def test_page_is_light_or_dark_as_the_reader_has_it(opened):
    light, _ = opened()
    dark, console = opened(None, DARK)

    assert "fill: rgb(28, 33, 38)" in part(light, "ospa")
    assert "fill: rgb(230, 233, 236)" in part(dark, "ospa")
    assert console == []


def framed(opened, tmp_path, record, width, said):
    """Return the DOM and the console's lines of a page in a window that is `width` pixels wide.

    A browser's own window is wider than a phone. The title is what the script `said` returns.
    """
    post = f"parent.postMessage(innerWidth + ' px, ' + ({said})(), '*')"
    opened.write(record, f"addEventListener('load', () => setTimeout(() => {post}, 3000));")
    frame = tmp_path / "frame.html"
    frame.write_text(
        f'<iframe src="report.html" width={width} height=800 style="border: 0"></iframe><script>'
        "addEventListener('message', (event) => { document.title = event.data; });</script>"
    )
    return opened.shown(frame.as_uri())


@pytest.mark.parametrize("record", [record_of(3), record_of(1, truth=())], ids=["all", "part"])
def test_page_is_no_wider_than_a_phone(opened, tmp_path, record):
    said = (
        "() => { const { scrollWidth, clientWidth } = document.documentElement;"
        "return scrollWidth - clientWidth + ' hidden'; }"
    )
    dom, console = framed(opened, tmp_path, record, PHONE, said)

    assert f"<title>{PHONE} px, 0 hidden</title>" in dom
    assert console == []


@pytest.mark.parametrize("width", [PHONE, 1200])
def test_the_scan_shown_is_told_in_one_line(opened, tmp_path, width):
    nothing = np.zeros((0, 2)), np.zeros(0)
    plots = tuple(Plot(stamp_ns(k), "radar_1", *nothing) for k in range(1075))
    record = record_of(1, plots=plots, truth=(), filtered=(), smoothed=())
    said = (
        "() => { show(1059);"
        "const line = parseFloat(getComputedStyle(shown).lineHeight);"
        "return shown.textContent + ', ' + Math.round(shown.offsetHeight / line) + ' lines'; }"
    )
    dom, console = framed(opened, tmp_path, record, width, said)

    assert f"<title>{width} px, 105.9 min, scan 1060 of 1075, 1 lines</title>" in dom
    assert console == []


def test_page_of_one_class_shows_it_once_by_its_name(opened):
    dom, console = opened(replace(record_of(1), class_names=("<car>",)))

    assert console == []
    for name in ("ospa", "numbers"):
        assert part(dom, name).count('class="xy') or 'class="subplot xy"' in part(dom, name)
    assert "all classes" not in dom.partition("<h2>Definitions")[0]
    assert '<div id="classes"' not in dom
    assert '<th scope="row">&lt;car&gt;</th>' in dom


def test_page_is_refused_anything_from_elsewhere(opened):
    _, console = opened(None, then='new Image().src = "http://127.0.0.1:9/x.png";')

    assert len(console) == 1
    assert "Content Security Policy" in console[0]
