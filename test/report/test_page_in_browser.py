"""The report's page in a real browser: it draws, moves, complains of nothing and loads nothing."""

import json
import re
import subprocess
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from headless import BROWSER, FLAGS, NAMES
from records import SCANS, estimates_of, record_of, stamp_ns, truth_of

from phd_jdtc_ros.core.types import UNKNOWN, Attributes
from phd_jdtc_ros.report.page import html
from phd_jdtc_ros.report.page.html import write_report
from phd_jdtc_ros.report.record import RadarPlots

DUMPING = ("--virtual-time-budget=20000", "--enable-logging=stderr", "--dump-dom")
PHONE = 390
DARK = "--blink-settings=preferredColorScheme=0"

pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(NAMES)} is installed")


class Opener:
    """Writes a record's page into a directory and opens it; returns DOM and console's lines."""

    def __init__(self, directory):
        self.directory = directory

    def __call__(self, record=None, *flags, at="", then=""):
        return self.shown(self.write(record, then).as_uri() + at, *flags)

    def shown(self, address, *flags):
        profile = f"--user-data-dir={self.directory / 'profile'}"
        done = subprocess.run(
            [BROWSER, *FLAGS, *DUMPING, *flags, profile, address],
            check=False,
            capture_output=True,
            text=True,
            timeout=120,
        )
        return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]

    def write(self, record=None, then=""):
        record = record_of(3) if record is None else record
        evaluation = record.evaluate(1000.0, 2.0)
        path = write_report(
            self.directory / "report.html",
            "A run",
            evaluation.summary(),
            record,
            html.charts_of(record, evaluation),
            html.notes_of(record, evaluation),
        )
        path.write_text(path.read_text().replace("</body>", f"<script>{then}</script></body>"))
        return path


@pytest.fixture
def opened(tmp_path):
    return Opener(tmp_path)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Return the DOM and the console's lines of the page of a whole record."""
    return Opener(tmp_path_factory.mktemp("drawn"))()


def part(dom, name):
    return re.search(rf'<div id="{name}".*?</figure>', dom, re.DOTALL).group()


def test_page_draws_every_chart_and_complains_of_nothing(drawn):
    dom, console = drawn
    assert console == []
    assert 'data-drawn="yes"' in dom
    for name in ("ospa", "numbers", "classes"):
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


def test_page_of_radars_with_hostile_names_draws_its_charts(opened):
    record, names = record_of(3), ("<!--<script>", "</script><script>throw 1</script>")
    # Every plot and every radar once with each name.
    plots = tuple(replace(plot, radar=name) for name in names for plot in record.plots)
    sites = tuple(replace(site, name=name) for name in names for site in record.radars)
    dom, console = opened(replace(record, plots=plots, radars=sites))
    assert console == []
    assert 'data-drawn="yes"' in dom
    for chart in ("ospa", "numbers", "classes"):
        assert '<svg class="main-svg"' in part(dom, chart)


def air_picture():
    """Return a record of two aircraft with labels: a low one that climbs, and a high one."""
    attributes = Attributes(
        np.array([[1524.0, 5.0], [9144.0, 0.0]]),
        np.tile(np.eye(2), (2, 1, 1)),
        np.array([0o4217, UNKNOWN]),
        np.array([UNKNOWN, 0x3C6555]),
    )
    sets = tuple(
        replace(estimates_of(k, 2, 0), track_id=np.array([7, 9]), attributes=attributes)
        for k in range(SCANS)
    )
    # The second target is not there for a while.
    truth = tuple(truth_of(k, 1 if 3 <= k < 9 else 2) for k in range(SCANS))
    return record_of(2, filtered=sets, smoothed=(), truth=truth)


# Scripts that return a text each. One page runs them in this order: what a script chooses it takes
# back, except for the selected track.
LEFT = (
    "const left = () => { picture.draw();"
    'return [...document.querySelectorAll("#tracks tr")].map((row) => '
    "row.cells[0].textContent.match(/\\((\\d+)\\)/)[1]).join(); };"
)
SCRIPTS = {
    "list": (
        'return [...document.querySelectorAll("#tracks tr")].map((row) => '
        '[...row.cells].map((cell) => cell.textContent).join(" ")).join(", ");'
    ),
    "gaps": (
        "const { truth } = picture.groups; let begun = 0;"
        "picture.brush.moveTo = () => { begun += 1; };"
        "picture.trace(truth, truth.start[0], truth.start[1] - 1, -1, 1); const whole = begun;"
        "picture.trace(truth, truth.start[1], truth.frame.length - 1, -1, 1);"
        "delete picture.brush.moveTo; return [whole, begun - whole].join();"
    ),
    "trails": (
        'return ["0", "30", "all"].map((seconds) => picture.frame - picture.since(seconds)).join();'
    ),
    "keys": (
        "const { scale, centre } = picture; const press = (key) => "
        'picture.canvas.dispatchEvent(new KeyboardEvent("keydown", { key }));'
        'press("+"); press("ArrowRight");'
        "const moved = [picture.scale > scale, picture.centre[0] > centre[0]];"
        'press("0"); return [...moved, picture.scale === scale].join();'
    ),
    **{
        name: (
            f'{LEFT} const level = document.getElementById("{name}"); level.value = "100";'
            'const found = left(); level.value = ""; return found;'
        )
        for name in ("low", "high")
    },
    "class": (
        f'{LEFT} const shown = document.getElementById("class1"); shown.checked = false;'
        "const found = left(); shown.checked = true; return found;"
    ),
    "all": f"{LEFT} return left();",
    "sorted": (
        f'{LEFT} const heads = document.querySelectorAll(".list th button");'
        "const sorted = (column) => { heads[column].click(); return left(); };"
        'return [sorted(1), sorted(1), sorted(0), sorted(0)].join(" ");'
    ),
    "found": (
        f'{LEFT} const input = document.getElementById("search"); input.value = " 3c65 ";'
        'const found = [left(), document.getElementById("count").textContent].join(": ");'
        'input.value = ""; return found;'
    ),
    "levels": 'return [-1, -12, 7, 380].map(flightLevel).join(" ");',
    "time": "return shown.textContent;",
    # Every text of the picture as its box, at several scales.
    "texts": (
        "const found = [], { brush, scale } = picture;"
        "for (const factor of [1, 1.5, 4, 40]) {"
        "  const boxes = []; picture.scale = scale * factor;"
        "  brush.fillText = (text, x, y) => {"
        "    boxes.push([x, y - 9, x + brush.measureText(text).width, y, text]); };"
        "  picture.draw(); delete brush.fillText;"
        "  const apart = boxes.every((one, k) => boxes.slice(k + 1).every((other) =>"
        "    !meet(one, other)));"
        "  found.push([apart, boxes.every((box) => picture.inside(box)), boxes.length > 2,"
        "    boxes.find((box) => /^[125]0* k?m$/.test(box[4]))[4]].join());"
        '} picture.scale = scale; return found.join(";");'
    ),
    "selected": (
        'document.querySelectorAll("#tracks button")[1].click(); picture.draw();'
        'const pressed = document.querySelector("[aria-pressed=true]").textContent;'
        'return [picture.selected, pressed, document.getElementById("details").textContent].join();'
    ),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return the results of the scripts on the drawn page of `air_picture`, by the page's title."""
    functions = ",".join(f'"{name}": () => {{ {script} }}' for name, script in SCRIPTS.items())
    then = (
        # The browser's clock is virtual and jumps from timer to timer: real work gives real time.
        "const waiting = setInterval(() => {"
        'if (!document.querySelector("#tracks tr")) {'
        "for (let k = 0; k < 1e7; k += 1) window.worked = Math.sqrt(k); return; }"
        f"clearInterval(waiting); const scripts = {{ {functions} }}; document.title = "
        "JSON.stringify(Object.fromEntries(Object.entries(scripts).map(([name, run]) => "
        "[name, run()]))); }, 100);"
    )
    directory = tmp_path_factory.mktemp("results")
    dom, console = Opener(directory)(air_picture(), at=f"#scan={SCANS}", then=then)
    assert console == []
    return json.loads(unescape(re.search("<title>(.*?)</title>", dom)[1]))


def test_picture_shows_tracks_with_gaps_trails_and_keys(results):
    assert results["list"] == (
        "4217 (7) FL050\N{UPWARDS ARROW} 110 kt 045°, 3C6555 (9) FL300 110 kt 045°"
    )
    assert results["selected"].startswith("9,3C6555 (9),Track 9, address 3C6555, class 1 (100 %)")
    assert results["gaps"] == "1,2"
    # Scans 6 s apart, with the shown one.
    assert results["trails"] == f"1,6,{SCANS}"
    assert results["keys"] == "true,true,true"


def test_tracks_are_sorted_by_each_column_and_found_by_their_names(results):
    assert results["sorted"] == "7,9 9,7 9,7 7,9"
    assert results["found"] == "9: 1 of 2 tracks"


def test_levels_below_zero_have_their_sign_first(results):
    assert results["levels"] == "FL-001 FL-012 FL007 FL380"


def test_time_of_day_stands_beside_the_time_from_the_first_scan(results):
    assert results["time"] == f"22:14:26 UTC, 66.0 s, scan {SCANS} of {SCANS}"


def test_texts_of_the_picture_are_apart_and_whole_and_the_scale_follows_the_zoom(results):
    found = [each.split(",") for each in results["texts"].split(";")]
    assert [each[:3] for each in found] == [["true"] * 3] * 4
    metres = [each[3] for each in found]
    assert len({*metres}) >= 3


@pytest.mark.parametrize(
    ("choice", "left"), [("low", "9"), ("high", "7"), ("class", "7"), ("all", "7,9")]
)
def test_tracks_are_filtered_by_level_and_class(results, choice, left):
    assert results[choice] == left


# This script reads what is shown at first, once all has been played, and after a click on a time;
# then it asks for a page from elsewhere.
PLAYED = """{
    const texts = [], text = () => shown.textContent;
    const clicked = () => {
        texts.push(text());
        document.title = JSON.stringify(texts);
        new Image().src = "http://127.0.0.1:9/x.png";
    };
    const begin = () => {
        texts.push(text());
        play.click();
        const waiting = setInterval(() => {
            if (play.textContent !== "Play") return;
            clearInterval(waiting);
            texts.push(text());
            document.getElementById("ospa").emit("plotly_click", {points: [{x: 31.0}]});
            setTimeout(clicked, 500);
        }, 100);
    };
    setTimeout(begin, 2000);
}
"""


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """Return what was shown one after the other, and the console's lines."""
    dom, console = Opener(tmp_path_factory.mktemp("played"))(None, at="#scan=3", then=PLAYED)
    return json.loads(unescape(re.search("<title>(.*?)</title>", dom)[1])), console


def test_play_goes_on_and_nothing_is_loaded_from_elsewhere(played):
    (first, last, _), _ = played
    assert f"12.0 s, scan 3 of {SCANS}" in first
    assert f"66.0 s, scan {SCANS} of {SCANS}" in last
    (*_, clicked), _ = played
    assert f"30.0 s, scan 6 of {SCANS}" in clicked
    _, (line,) = played
    assert "Content Security Policy" in line


def test_page_is_light_or_dark_as_the_reader_has_it(opened, drawn):
    light, _ = drawn
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
def test_the_shown_scan_is_summarised_in_one_line(opened, tmp_path, width):
    nothing = np.zeros((0, 2)), np.zeros(0)
    plots = tuple(RadarPlots(stamp_ns(k), "radar_1", *nothing) for k in range(1075))
    record = record_of(1, plots=plots, truth=(), filtered=(), smoothed=())
    said = (
        "() => { show(1059);"
        "const line = parseFloat(getComputedStyle(shown).lineHeight);"
        "return shown.textContent + ', ' + Math.round(shown.offsetHeight / line) + ' lines'; }"
    )
    dom, console = framed(opened, tmp_path, record, width, said)
    shown = "23:59:14 UTC, 105.9 min, scan 1060 of 1075, 1 lines"
    assert f"<title>{width} px, {shown}</title>" in dom
    assert console == []


def test_page_of_one_class_shows_it_once_by_its_name(opened):
    dom, console = opened(replace(record_of(1), class_names=("<car>",)))
    assert console == []
    for name in ("ospa", "numbers"):
        assert part(dom, name).count('class="xy') or 'class="subplot xy"' in part(dom, name)
    assert "all classes" not in dom.partition("<h2>Definitions")[0]
    assert '<div id="classes"' not in dom
    assert '<th scope="row">&lt;car&gt;</th>' in dom
