"""The live page in a real browser: the view that follows the traffic, own ship and alarms."""

import json
import re
import subprocess
from html import unescape

import pytest
from headless import BROWSER, FLAGS, NAMES

from phd_jdtc_ros.nodes.picture import page
from phd_jdtc_ros.nodes.picture_server import head

pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"none of {', '.join(NAMES)} is installed")

SCRIPT = """
const zeros = (count) => new Array(count).fill(0);
let time = 1.7e9;
function show(...places) {
  const n = places.length;
  const columns = ["vx", "vy", "course", "climb", "class", "minor", "major", "angle"];
  live.takeTracks({
    time_s: time += 1, number: places.map((_, k) => k + 1),
    x: places.map(([x]) => x), y: places.map(([, y]) => y),
    ...Object.fromEntries(columns.map((name) => [name, zeros(n)])),
    level: zeros(n).fill(-9999), share: zeros(n).fill(100), weight: zeros(n).fill(100),
    state: zeros(n).fill(1), who: zeros(n).map(() => ["", ""]),
  });
}
const within = (value, end) => value > 0 && value < end;
const seen = (x, y) => within(live.px(x), live.width) && within(live.py(y), live.height);
const raise = (...texts) => live.take("alarms", {
  kind: texts.map((_, k) => k), first: texts.map((_, k) => k), second: texts.map((_, k) => k + 1),
  alarm: zeros(texts.length).fill(1), chance: zeros(texts.length).fill(90),
  x: zeros(texts.length), y: zeros(texts.length), text: texts,
});
const told = () => document.getElementById("alarm").textContent;
const found = [];
show([100, 100]);
show([100, 100], [50000, 0]);
found.push(seen(50000, 0));
live.zoom(2);
show([100, 100], [50000, 0], [0, 90000]);
found.push(seen(0, 90000));
live.fit();
show([100, 100], [50000, 0], [0, 90000]);
found.push(seen(0, 90000));
live.take("carriers", { number: [0], x: [10], y: [20] });
raise("own ship and track 1", "track 1 and track 2");
show([100, 100], [50000, 0]);
let lines = 0;
live.brush.lineTo = () => { lines += live.brush.strokeStyle === ALARM; };
live.draw();
found.push(lines, [...live.newest("carriers")].length, told());
raise();
found.push(told());
document.title = JSON.stringify(found);
"""


def test_view_grows_until_it_is_moved_and_own_ships_alarms_are_drawn(tmp_path):
    quiet = "<script>window.EventSource = class { addEventListener() {} };</script>"
    text = page("/tracker", head({"sensors": ["mast"], "mast.pose": "/ship"}))
    text = text.replace("<body>", f"<body>{quiet}").replace(
        "</body>", f"<script>{SCRIPT}</script></body>"
    )
    path = tmp_path / "live.html"
    path.write_text(text, "utf-8")
    flags = ("--dump-dom", "--virtual-time-budget=3000", f"--user-data-dir={tmp_path / 'profile'}")
    done = subprocess.run(
        [BROWSER, *FLAGS, *flags, path.as_uri()],
        check=False,
        capture_output=True,
        text=True,
        timeout=120,
    )
    found = json.loads(unescape(re.search("<title>(.*?)</title>", done.stdout)[1]))
    words = "own ship and track 1; and 1 more"
    assert found == [True, False, True, 2, 1, words, ""]
