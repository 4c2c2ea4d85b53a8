# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation as a site, and its pictures."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXTS = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
specification = importlib.util.spec_from_file_location(
    "pictures", ROOT / "docs" / "tools" / "pictures.py"
)
pictures = importlib.util.module_from_spec(specification)
specification.loader.exec_module(pictures)


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
    # What the converter does not know it leaves as it was written.
    assert [
        equation
        for equation in re.findall(r"<math .*?</math>", page, re.DOTALL)
        if re.search(r"[\\$]|&(?:amp|#x00026);", equation)
    ] == []


def test_site_describes_a_packages_modules(site):
    page = (site / "code" / "core" / "smc.html").read_text()

    assert "<code>backward_kernel.py</code>" in page
    assert "stored set t+1" in page
    assert ":::" not in page


def test_site_loads_nothing_from_elsewhere(site):
    loaded = {
        address
        for page in site.rglob("*.html")
        for address in re.findall(
            r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(https?:[^"]+)', page.read_text()
        )
    }

    assert (site / "search" / "search_index.json").exists()
    assert loaded == set()


def test_report_is_photographed_where_there_is_a_browser(tmp_path):
    if not any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))):
        pytest.skip("no Chromium")
    page, picture = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text("<p>a page</p>")

    assert pictures.photograph(page, picture) is None
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_missing_page_names_what_makes_it(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "BROWSERS", ("true",))

    fault = pictures.photograph(tmp_path / "report.html", tmp_path / "report.png")

    assert "`make demo` makes report.html" in fault


def test_missing_browser_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "BROWSERS", ("no-such-browser",))

    assert "needs Chromium" in pictures.photograph(tmp_path / "report.html", tmp_path / "r.png")


def test_every_picture_of_the_documentation_is_made_by_a_command():
    made = {Path(source).name for source in pictures.SOURCES} | {pictures.REPORT}
    shown = {
        Path(name).name
        for page in TEXTS
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())
    }

    assert made == shown == {path.name for path in (ROOT / "docs" / "images").iterdir()}
