"""The documentation's pictures from what is in ``out/``: ``make pictures``.

A picture whose output is not there, or is of a quick run, is left as it is, and the command that
makes it is named.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs" / "images"
PAGE = ROOT / "out" / "demo" / "report.html"
REPORT = "report.png"
# The one of `make study` has a curve for each of its thirty variants.
CORRECTIONS = "the command in docs/study.md, The effect of each correction"
# Each picture by its source, and what makes that.
SOURCES = {
    "out/demo/trajectories.png": "make demo",
    "out/demo/ospa.png": "make demo",
    "out/study_corrections/figures/clutter_20/ospa_against_lag.png": CORRECTIONS,
    "out/bench/cost_against_particles_per_target.png": "make bench",
    "out/bench/cost_against_targets.png": "make bench",
    "out/bench/step_against_targets.png": "make bench",
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = "1200,1640"


def copy_all() -> list[str]:
    """Copy the pictures that are there; return a line for each that is not."""
    missing = []
    for source, command in SOURCES.items():
        path = ROOT / source
        if path.exists() and not of_a_quick_run(path):
            shutil.copyfile(path, IMAGES / path.name)
        else:
            missing.append(f"left as it is: docs/images/{path.name}; {command} makes {source}")
    return missing


def of_a_quick_run(path: Path) -> bool:
    """Return whether the summary beside a picture says that its run was a short one."""
    summary = path.with_name("summary.json")
    return summary.exists() and bool(json.loads(summary.read_text()).get("quick"))


def photograph(page: Path, picture: Path) -> str | None:
    """Write a picture of a page's top; return what is wrong, or None."""
    left = f"left as it is: docs/images/{picture.name}"
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        return f"{left}; it needs Chromium, such as `apt install chromium`"
    if not page.exists():
        return f"{left}; `make demo` makes {page.name}"
    with tempfile.TemporaryDirectory() as profile:
        flags = [f"--user-data-dir={profile}", "--headless", "--no-sandbox", "--hide-scrollbars"]
        shot = [f"--window-size={SIZE}", "--virtual-time-budget=10000", f"--screenshot={picture}"]
        done = subprocess.run(
            [browser, *flags, *shot, page.as_uri()], capture_output=True, timeout=120, check=False
        )
    return None if done.returncode == 0 else f"{browser} failed: {done.stderr.decode()[-300:]}"


def main() -> int:
    """Write all pictures that can be written; the status is 1 if the report's could not be."""
    fault = photograph(PAGE, IMAGES / REPORT)
    for line in filter(None, [*copy_all(), fault]):
        print(line, file=sys.stderr)
    return int(fault is not None)


if __name__ == "__main__":
    sys.exit(main())
