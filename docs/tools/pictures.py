"""Makes the documentation's pictures again, those of the demo from out/demo.

The diagrams (SVG) are drawn by hand. Curves are drawn from the tables of the pages that show them,
which page_tables.py fills.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import curves
import hero

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
IMAGES = DOCS / "images"
DEMO = ROOT / "out" / "demo"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = "1200,1640"


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
    """Write all pictures; the status is 1 if the report's could not be written."""
    curves.write_all(DOCS, IMAGES)
    hero.write(DEMO / "estimates", IMAGES / "tracks.gif")
    fault = photograph(DEMO / "report.html", IMAGES / "report.png")
    if fault:
        print(fault, file=sys.stderr)
    return int(fault is not None)


if __name__ == "__main__":
    sys.exit(main())
