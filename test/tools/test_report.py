"""The report tool on a bag: the page and the pictures."""

import json
import re
import sys
from collections import Counter

import pytest

from msg_adapters.encoding import names
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.report import page
from robustness.hostile_input.bags import outcome
from robustness.hostile_input.small_chunks import rewritten


def test_report_writes_a_page_and_pictures(tracked, tmp_path, capsys):
    out = tmp_path / "report"
    assert run("report", [str(tracked), "--out", str(out), "--title", "Eight scans"]) == 0
    assert "<h1>Eight scans</h1>" in (out / "report.html").read_text()
    assert {"scenario.png", "measurements.png", "trajectories.png", "ospa.png"} <= {
        path.name for path in out.iterdir()
    }
    assert "report.html" in capsys.readouterr().out


def test_report_of_untracked_detections_notes_what_is_missing(short_bag, tmp_path, capsys):
    words = ["-p", "radar_2.topic:=/wrong/detections"]
    assert run("report", [str(short_bag), "--out", str(tmp_path), *words]) == 0
    said = capsys.readouterr().err.splitlines()[-1]
    missing = "/wrong/detections is missing, so the detections of radar_2 are not shown"
    assert said == f"report: {short_bag}: {missing}"
    text = (tmp_path / "report.html").read_text()
    assert "There are no estimates in this bag" in text
    assert '<canvas id="map"' in text
    assert re.findall(r'<div id="(\w+)"', text)[-1] == "numbers"


def test_report_of_a_recording_cut_by_a_kill_shows_every_whole_chunk(tracked, tmp_path, capsys):
    whole = rewritten(tracked, tmp_path / "whole.mcap")
    killed = tmp_path / "killed.mcap"
    killed.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    topics = {names.estimates("filtered"), names.TRUTH}
    messages, _ = outcome(killed)
    intact = Counter(message.topic for message in messages)
    assert all(0 < intact[topic] < 8 for topic in topics)
    assert run("report", [str(killed), "--out", str(tmp_path / "out")]) == 3
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert re.fullmatch(
        rf"report: {killed}: is damaged: it is truncated; \d+ of its bytes are lost", line
    )
    page = (tmp_path / "out" / "report.html").read_text()
    assert f"Only the intact part is shown. {line.removeprefix('report: ')}." in page
    times = json.loads(re.search(r'id="run">(.*?)</script>', page, re.DOTALL)[1])["times"]
    assert len(times) == len({message.stamp_ns for message in messages})
    assert "report.html" in said.out
    assert (tmp_path / "out" / "ospa.png").exists()


@pytest.mark.parametrize(
    ("bag", "out", "fault"),
    [
        ("none", "out", "none: no such bag"),
        (
            None,
            "file/report",
            "file/report: cannot be made, {}/file is a file, must be a directory",
        ),
        (None, "file", "file: is a file, must be a directory"),
    ],
)
def test_report_refuses_wrong_paths(short_bag, tmp_path, capsys, bag, out, fault):
    (tmp_path / "file").write_text("mine")
    source = tmp_path / bag if bag else short_bag
    assert run("report", [str(source), "--out", str(tmp_path / out)]) == 2
    assert capsys.readouterr().err == f"report: {tmp_path / fault.format(tmp_path)}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "mine"


def test_report_without_plotly_writes_the_pictures_and_names_what_to_install(
    tracked, tmp_path, monkeypatch, capsys
):
    # As if the page had never been imported.
    monkeypatch.delitem(sys.modules, "phd_jdtc_ros.report.page.html", raising=False)
    monkeypatch.delattr(page, "html", raising=False)
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    assert run("report", [str(tracked), "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "report: the page needs plotly: pip install plotly\n"
    assert (tmp_path / "ospa.png").exists()
    assert not (tmp_path / "report.html").exists()


def test_report_takes_another_cutoff_and_names_of_the_classes(tracked, tmp_path, capsys):
    names = ("ship", "buoy")
    options = [f"classes:=[{', '.join(names)}]", *(f"{n}.snr_band_db:=[10.0, 50.0]" for n in names)]
    given = [word for option in options for word in ("-p", option)]
    assert run("report", [str(tracked), "--out", str(tmp_path), "--cutoff", "25.5", *given]) == 0
    assert "c = 25.5 m" in capsys.readouterr().out
    page = (tmp_path / "report.html").read_text()
    assert "Here p = 2, c = 25.5 m." in page
    for name in names:
        assert f">{name}</th>" in page
        assert f'"{name}"' in page
    assert "class 0" not in page
