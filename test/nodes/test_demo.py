"""The main job, for real: three processes over DDS on the shipped bag."""

import json
import os
import re
import signal
import time
from pathlib import Path

import pytest
from bag_content import messages, rewrite

from msg_adapters.encoding import names
from msg_adapters.outgoing import outputs
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.tools.demo.demo import ARTEFACTS

ROOT = Path(__file__).parents[2]
BAG, README = ROOT / "bags" / "paper_scenario", ROOT / "README.md"
# The picture of clutter is one of radars that learn its map.
WITHOUT_MAP = {*ARTEFACTS} - {"clutter.png"}


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo")
    assert run("demo", ["--bag", str(BAG), "--out", str(out)]) == 0
    return out


def clouds(path, topic):
    return {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in messages(path, topic)}


def broken(metrics):
    """Return the names of the promised figures that are not reached."""
    filtered, smoothed = (metrics[source]["all"] for source in ("filtered", "smoothed"))
    promised = {
        "filtered OSPA": filtered["ospa"] <= 115.0,
        "filtered cardinality": filtered["cardinality"] <= 15.0,
        "smoothed OSPA": smoothed["ospa"] <= 68.0,
        "smoothed number of targets": smoothed["cardinality_abs_error"] == 0.0,
        "reduction": metrics["reduction"] >= 0.30,
        "classes": metrics["class_accuracy"] >= 0.99,
        "tracks": metrics.get("identity_switches") == 0,
    }
    return {name for name, reached in promised.items() if not reached}


def test_demo_reaches_the_promised_figures(demo):
    metrics = json.loads((demo / "metrics.json").read_text())
    assert broken(metrics) == set()
    assert metrics["scans"] == 80
    assert (metrics["p"], metrics["c"]) == (2, 1000)
    assert set(metrics["smoothed"]) == {"all", "class_0", "class_1"}
    assert metrics["step_ms"]["median"] > 0.0
    assert metrics["engine"] == "gaussian"
    for source, consistency in metrics["consistency"].items():
        assert consistency["pairs"] == pytest.approx(240, abs=3), source
        assert consistency["outside_3_sigma"] <= 0.03, source
        assert 0.7 < consistency["nees"] < 1.3, source


def test_demo_shows_the_papers_filter_beside_the_tracker(demo):
    metrics = json.loads((demo / "metrics.json").read_text())
    printed, corrected = metrics["compared"]
    assert [each["engine"] for each in (printed, corrected)] == ["phd_as_printed", "phd"]
    for each in (printed, corrected):
        assert each["scans"] == metrics["scans"]
        assert each["step_ms"]["median"] > 0.0
    smoothed = [each["smoothed"]["all"]["ospa"] for each in (printed, corrected, metrics)]
    assert smoothed[0] > 1.5 * smoothed[1]
    assert smoothed[1] > smoothed[2]
    assert "The paper's filter" in (demo / "report.html").read_text()


def test_readmes_table_has_the_scores_of_the_demo(demo):
    metrics = json.loads((demo / "metrics.json").read_text())
    rows = dict(
        re.findall(r"^\| (\w+), (?:live|offline) \|(.+)\|$", README.read_text(), re.MULTILINE)
    )
    assert [*rows] == [found["engine"] for found in (*metrics["compared"], metrics)]
    for found, row in zip((*metrics["compared"], metrics), rows.values(), strict=True):
        ospa = [f"{found[source]['all']['ospa']:.1f} m" for source in ("filtered", "smoothed")]
        shares = [f"{found['reduction']:.0%}", f"{found['class_accuracy']:.1%}"]
        shown = [*ospa, *(share.replace("%", " %") for share in shares)]
        assert [cell.strip() for cell in row.split("|")] == shown


def test_live_estimates_equal_offline_ones(demo, tmp_path):
    still = tmp_path / "still"
    assert run("track_bag", [str(BAG), "--out", str(still)]) == 0
    for source in ("filtered", "smoothed"):
        topic = names.estimates(source)
        found, expected = clouds(demo / "estimates", topic), clouds(still, topic)
        assert {k: bytes(v.data) for k, v in found.items()} == {
            k: bytes(v.data) for k, v in expected.items()
        }
        assert len(found) == 80


def test_demo_records_everything_published(demo):
    reader = BagReader(demo / "estimates")
    expected = set(outputs.default_topics(2)) | {
        names.TRUTH,
        *map(names.detections, ("radar_1", "radar_2")),
    }
    assert set(reader.types) == expected
    for topic in expected - {names.DIAGNOSTICS, names.OSPA, names.manual()}:
        assert reader.counts[topic] == 80, topic
    assert reader.counts[names.OSPA] == 160


def test_demo_refuses_a_missing_bag_and_one_without_truth(tmp_path, capsys):
    assert run("demo", ["--bag", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    assert "none: no such bag" in capsys.readouterr().err
    blind = rewrite(BAG, tmp_path / "blind", drop=[names.TRUTH])
    assert run("demo", ["--bag", str(blind), "--out", str(tmp_path / "out")]) == 2
    assert names.TRUTH in capsys.readouterr().err


def test_demo_makes_what_it_would_remove(demo):
    assert {str(p.relative_to(demo)) for p in demo.rglob("*") if p.is_file()} == WITHOUT_MAP


def earlier(directory):
    """Write what a demo and its user may have left."""
    mine = {directory / name for name in ("photo.png", "logs/mine.log", "notes.html")}
    for path in (*mine, *(directory / name for name in ARTEFACTS)):
        path.parent.mkdir(exist_ok=True)
        path.write_text("of an earlier demo")
    return mine


def test_demo_replaces_its_own_files_alone(tmp_path, monkeypatch):
    def run_nodes(_, __, new, *___):
        (new / "estimates").mkdir()
        (new / "estimates" / "metadata.yaml").touch()
        (new / "metrics.json").write_text("{}")
        return True

    monkeypatch.setattr("phd_jdtc_ros.tools.demo.demo.run_nodes", run_nodes)
    monkeypatch.setattr("phd_jdtc_ros.tools.report.write", lambda *_: 0)
    mine = earlier(tmp_path)
    logs = {tmp_path / name for name in ARTEFACTS if name.startswith("logs/")}
    assert run("demo", ["--bag", str(BAG), "--out", str(tmp_path)]) == 0

    written = {tmp_path / "metrics.json", tmp_path / "estimates" / "metadata.yaml"}
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == mine | logs | written
    assert (tmp_path / "metrics.json").read_text() == "{}"


@pytest.mark.parametrize("how", ["failed", "interrupted"])
def test_demo_that_does_not_end_well_leaves_the_earlier_results(tmp_path, monkeypatch, capsys, how):
    def run_nodes(_, __, new, *___):
        (new / "metrics.json").write_text("null")
        if how == "interrupted":
            raise KeyboardInterrupt
        return False

    monkeypatch.setattr("phd_jdtc_ros.tools.demo.demo.run_nodes", run_nodes)
    earlier(tmp_path)
    before = {path: path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    status = run("demo", ["--bag", str(BAG), "--out", str(tmp_path)])

    assert status == {"failed": 1, "interrupted": 130}[how]
    assert {path: path.read_text() for path in tmp_path.rglob("*") if path.is_file()} == before
    text = f"demo: the results in {tmp_path} are those of an earlier demo\n"
    assert text in capsys.readouterr().err


def test_demo_refuses_a_recording_with_other_files(tmp_path, capsys):
    path = tmp_path / "estimates" / "mine.mcap"
    path.parent.mkdir()
    path.touch()
    assert run("demo", ["--bag", str(BAG), "--out", str(tmp_path)]) == 2
    assert path.exists()
    assert capsys.readouterr().err == (
        f"demo: {path}: is not of a demo, so {path.parent} is not replaced\n"
    )


def children(pid):
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
        except OSError:  # It has just ended
            continue
        if int(parent) == pid and state != "Z":
            found.append(int(path.parent.name))
    return found


def test_demo_ends_its_nodes_when_it_is_terminated(executables, tmp_path):
    out = tmp_path / "out"
    process = executables.start("demo", "--bag", BAG, "--out", out)
    log = out / "logs" / "tracker.log"
    end = time.monotonic() + 60.0
    while not (log.exists() and "tracking" in log.read_text()) and time.monotonic() < end:
        time.sleep(0.05)
    nodes = children(process.pid)
    process.send_signal(signal.SIGTERM)
    status = process.wait(30.0)
    left = [pid for pid in nodes if Path(f"/proc/{pid}").exists()]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert len(nodes) >= 2
    assert left == []
    assert status == 130
    assert process.log.read_text().endswith("demo: interrupted\n")
