"""A browser at the live picture that stays open for a week: what a picture costs, and the memory.

The page is that of the node, in Chromium without a graphics processor. What a tracker sends in a
week comes as fast as the page takes it: updates of 200 tracks, whose targets come and go, with
detections and alarms. A page that keeps what it should not would grow with every update, so that a
part of a week is enough.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.nodes import picture_server
from phd_jdtc_ros.nodes.picture import page
from phd_jdtc_ros.nodes.picture_server import Server

from ..harness.figures import Found, measures

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
TRACKS, UPDATES, LIFE = 200, 160, 100
# The page keeps all it may after two of these parts: 300 updates.
FILLED, PARTS = 2, 4
# Largest growth of the heap from the first part to the last one, and longest time of an update.
MOST_GROWTH, MOST_MS = 1.1, 500.0
PARAMETERS = {"sensors": ["radar"], "radar.position": [0.0, 0.0], "classes": ["ship", "boat"]}
# Tracks move in circles, and each has a new number after so many updates.
SCRIPT = """
(() => {
  const [tracks, begin, count, life] = [%d, %d, %d, %d], took = [], shown = [];
  const fill = (value) => new Array(tracks).fill(value);
  const row = [...Array(tracks).keys()];
  for (let k = begin; k < begin + count; k += 1) {
    const angle = row.map((i) => i + 0.002 * k * (1 + i %% 5));
    const number = row.map((i) => i + 1 + tracks * Math.floor((k + 2 * i) / life));
    const x = angle.map((a, i) => 200 * i * Math.cos(a));
    const y = angle.map((a, i) => 200 * i * Math.sin(a));
    const found = {
      time_s: 1.7e9 + 2.5 * k, number, x, y, vx: fill(30), vy: fill(-20), course: fill(70),
      level: fill(-32768), climb: fill(0), class: row.map((i) => i %% 2), share: fill(98),
      weight: fill(100), state: fill(1), minor: fill(20), major: fill(24), angle: fill(40),
      who: row.map((i) => ["", `A${k}${i}`]),
    };
    const start = performance.now();
    live.takeTracks(found);
    live.take("plots", { x: x.slice(0, 100), y: y.slice(0, 100), radar: fill(0).slice(0, 100) });
    live.take("alarms", { kind: [1], first: [number[0]], second: [number[1]], alarm: [1],
      chance: [90], x: [x[0]], y: [y[0]], text: ["an alarm"] });
    took.push(performance.now() - start);
    if (k %% 10 === 0) { live.draw(); shown.push(performance.now() - start); }
  }
  for (const each of [took, shown]) each.sort((a, b) => a - b);
  const middle = (sorted) => sorted[Math.floor(sorted.length / 2)];
  return [middle(took), middle(shown), shown[shown.length - 1]];
})()
"""


@measures(
    "a browser that stays open",
    f"memory at most {MOST_GROWTH:g} times that of the filled page; {TRACKS} tracks drawn within "
    f"{MOST_MS:g} ms",
)
def measure(count: int = UPDATES) -> Found:
    """Show updates in Chromium until the page keeps all it may, and then as many again."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        return f"not measured: none of {', '.join(BROWSERS)} is installed", False, {}
    head = picture_server.head(PARAMETERS)
    server = Server("127.0.0.1", 0, "", lambda: page("/tracker", head), dict, dict)
    try:
        with tempfile.TemporaryDirectory() as profile:
            words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,900"]
            words += ["--remote-debugging-port=0", f"--user-data-dir={profile}"]
            process = subprocess.Popen(
                [browser, *words, f"http://127.0.0.1:{server.port}/"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                parts = asyncio.run(_watch(Path(profile) / "DevToolsActivePort", count))
            finally:
                process.terminate()
                process.wait(30.0)
    finally:
        server.close()
    filled, last = parts[FILLED - 1], parts[-1]
    growth = last["heap"] / filled["heap"]
    measured = (
        f"{filled['heap'] / 1e6:.1f} MB after {FILLED * count} updates, "
        f"{last['heap'] / 1e6:.1f} MB after {count * len(parts)}; an update takes "
        f"{last['update_ms']:.0f} ms, with its picture "
        f"{last['picture_ms']:.0f} ms, at most {last['longest_ms']:.0f} ms"
    )
    figures = {"growth": growth, **{f"last_{name}": value for name, value in last.items()}}
    return measured, growth <= MOST_GROWTH and last["picture_ms"] <= MOST_MS, figures


async def _watch(port_file: Path, count: int) -> list[dict[str, float]]:
    """Return heap and times of each part of the updates."""
    import aiohttp

    for _ in range(600):
        if port_file.exists() and len(port_file.read_text().splitlines()) > 1:
            break
        await asyncio.sleep(0.1)
    port = port_file.read_text().splitlines()[0]
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{port}/json") as reply:
            pages = [each for each in await reply.json() if each["type"] == "page"]
        address = pages[0]["webSocketDebuggerUrl"]
        async with session.ws_connect(address, max_msg_size=0) as link:
            drawn = {"expression": "document.documentElement?.dataset.drawn"}
            while (await _ask(link, "Runtime.evaluate", drawn))["result"].get("value") != "yes":
                await asyncio.sleep(0.2)
            parts = []
            for part in range(PARTS):
                script = SCRIPT % (TRACKS, part * count, count, LIFE)
                answer = await _ask(
                    link, "Runtime.evaluate", {"expression": script, "returnByValue": True}
                )
                update_ms, picture_ms, longest_ms = answer["result"]["value"]
                await _ask(link, "HeapProfiler.collectGarbage", {})
                used = await _ask(link, "Runtime.getHeapUsage", {})
                parts.append(
                    {
                        "heap": float(used["usedSize"]),
                        "update_ms": float(update_ms),
                        "picture_ms": float(picture_ms),
                        "longest_ms": float(longest_ms),
                    }
                )
    return parts


async def _ask(link: Any, method: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a command of Chromium's DevTools."""
    await link.send_str(json.dumps({"id": 1, "method": method, "params": parameters}))
    async for message in link:
        answer = json.loads(message.data)
        if answer.get("id") == 1:
            if "error" in answer or "exceptionDetails" in answer["result"]:
                raise RuntimeError(message.data)
            found: dict[str, Any] = answer["result"]
            return found
    raise RuntimeError(f"{method}: no answer")
