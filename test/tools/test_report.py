# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report tool on a bag: the page and the pictures."""

import re
import subprocess
import sys

from phd_jdtc_ros.__main__ import run


def test_report_writes_a_page_and_pictures(tracked, tmp_path, capsys):
    out = tmp_path / "report"

    assert run("report", [str(tracked), "--out", str(out), "--title", "Eight scans"]) == 0

    assert "<h1>Eight scans</h1>" in (out / "report.html").read_text()
    assert {"scenario.png", "measurements.png", "trajectories.png", "ospa.png"} <= {
        path.name for path in out.iterdir()
    }
    assert "report.html" in capsys.readouterr().out


def test_report_of_untracked_detections_says_that_there_are_no_estimates(short_bag, tmp_path):
    assert run("report", [str(short_bag), "--out", str(tmp_path)]) == 0

    text = (tmp_path / "report.html").read_text()
    assert "There are no estimates in this bag" in text
    assert re.findall(r'<div id="(\w+)"', text) == ["map", "numbers"]


def test_report_refuses_a_missing_bag(tmp_path, capsys):
    assert run("report", [str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    assert "no such bag" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_report_refuses_a_directory_that_cannot_be_made(short_bag, tmp_path, capsys):
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "report"
    assert run("report", [str(short_bag), "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"report: {out}: Not a directory\n"


def test_report_without_plotly_writes_the_pictures_and_says_what_to_install(tracked, tmp_path):
    script = (
        "import sys; sys.modules['plotly'] = None; from phd_jdtc_ros.__main__ import run; "
        f"sys.exit(run('report', [{str(tracked)!r}, '--out', {str(tmp_path)!r}]))"
    )

    done = subprocess.run(
        [sys.executable, "-c", script], check=False, capture_output=True, text=True, timeout=120
    )

    assert done.returncode == 1
    assert done.stderr.strip().endswith("pip install plotly")
    assert "Traceback" not in done.stderr
    assert (tmp_path / "ospa.png").exists()
    assert not (tmp_path / "report.html").exists()
