"""The documentation as a site, and its pictures."""

import json
import os
import queue
import re
import shutil
import subprocess
import sys
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pictures
import pytest
from headless import BROWSER, FLAGS

ROOT = Path(__file__).parents[2]
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
WIDE, PHONE = 1440, 390
# Opens every page at every width, and sends what is wider than the window, or than its column.
MEASURE = """<!doctype html><title>measure</title><body><script>
const wide = (box) => box.scrollWidth > box.clientWidth + 1;
const open = (page, width) => new Promise((done) => {
  const frame = document.createElement("iframe");
  frame.style.cssText = `width: ${width}px; height: 900px`;
  frame.src = page;
  frame.onload = () => setTimeout(() => {
    const found = frame.contentDocument;
    const tables = [...found.querySelectorAll(".md-content table")];
    const column = found.querySelector(".md-content__inner").getBoundingClientRect();
    const over = tables.filter((table) => table.getBoundingClientRect().right > column.right + 1
      || wide(table) || wide(table.closest(".md-typeset__scrollwrap") || table));
    frame.remove();
    done({page, width, tables: tables.length, over: over.map((table) => table.rows[0].innerText),
          page_width: found.documentElement.scrollWidth});
  }, 50);
  document.body.append(frame);
});
Promise.all(PAGES.flatMap((page) => WIDTHS.map((width) => open(page, width)))).then((found) => {
  fetch("found", {method: "POST", body: JSON.stringify(found)});
});
</script>"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the directory of the site, built as `make docs` does."""
    for module in ("material", "latex2mathml"):
        pytest.importorskip(module)
    directory = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", directory],
        check=False,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (built.returncode, built.stderr) == (0, "")
    return directory


def test_equations_of_the_site_are_mathml(site):
    page = (site / "method.html").read_text()

    assert page.count("<math ") > 100
    assert page.count('display="block"') > 10
    assert 'class="arithmatex"' not in page
    # The converter leaves what it cannot convert as it was written.
    equations = re.findall(r"<math .*?</math>", page, re.DOTALL)
    assert [each for each in equations if re.search(r"[\\$]|&(?:amp|#x00026);", each)] == []


def test_site_describes_packages_and_labels_the_cells_of_tables(site):
    core, tracker, study = (
        (site / name).read_text()
        for name in ("code/core/gaussian.html", "nodes/tracker.html", "study_details.html")
    )
    assert "<code>update.py</code>" in core
    assert "stored mixture t+1" in core
    assert ":::" not in core
    assert '<td data-label="QoS">reliable, depth 10</td>' in tracker
    assert "<td>" not in tracker
    # Figures stay on one line.
    assert ">126.9\N{NO-BREAK SPACE}m</td>" in study
    assert ">194.5\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}10.4 / " in study


def test_site_loads_nothing_from_elsewhere(site):
    pattern = r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(https?:[^"]+)'
    loaded = {a for page in site.rglob("*.html") for a in re.findall(pattern, page.read_text())}

    assert (site / "search" / "search_index.json").exists()
    assert loaded == set()


class Handler(SimpleHTTPRequestHandler):
    """Serves the site, and takes what the measuring page finds."""

    def __init__(self, *arguments, found, **options):
        self.found = found
        super().__init__(*arguments, **options)

    def do_POST(self):
        self.found.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def measured(site, tmp_path_factory):
    """Return what a browser finds of every page with a table, at both widths."""
    if BROWSER is None:
        pytest.skip("no Chromium")
    pages = [
        str(page.relative_to(site))
        for page in site.rglob("*.html")
        if "<table>" in page.read_text()
    ]
    text = MEASURE.replace("PAGES", json.dumps(pages)).replace("WIDTHS", f"[{WIDE}, {PHONE}]")
    (site / "measure.html").write_text(text)
    found = queue.Queue()
    handler = partial(Handler, directory=str(site), found=found)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        profile = f"--user-data-dir={tmp_path_factory.mktemp('profile')}"
        address = f"http://127.0.0.1:{server.server_port}/measure.html"
        browser = subprocess.Popen([BROWSER, *FLAGS, profile, address], stderr=subprocess.DEVNULL)
        try:
            return found.get(timeout=120.0)
        finally:
            browser.terminate()
            browser.wait(20.0)
            server.shutdown()


@pytest.mark.parametrize("width", [WIDE, PHONE])
def test_every_table_fits_its_column(measured, width):
    pages = [page for page in measured if page["width"] == width]

    assert sum(page["tables"] for page in pages) > 60
    assert {page["page"]: page["over"] for page in pages if page["over"]} == {}
    assert [page["page"] for page in pages if page["page_width"] > width] == []


def test_report_is_photographed_where_there_is_a_browser(tmp_path):
    if not any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))):
        pytest.skip("no Chromium")
    page, picture = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text("<p>a page</p>")

    assert pictures.photograph(page, picture) is None
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("browser", "words"),
    [("true", "`make demo` makes report.html"), ("no-such-browser", "needs Chromium")],
)
def test_what_a_photograph_lacks_is_named(tmp_path, monkeypatch, browser, words):
    monkeypatch.setattr(pictures, "BROWSERS", (browser,))
    assert words in pictures.photograph(tmp_path / "report.html", tmp_path / "report.png")


def test_every_picture_of_the_documentation_is_shown():
    shown = {
        Path(name).name
        for page in TEXTS
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())
    }

    assert shown == {path.name for path in (ROOT / "docs" / "images").iterdir()}
