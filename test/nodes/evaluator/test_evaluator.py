"""What an evaluator publishes, writes and prints, and when it ends."""

import json
import os

import numpy as np
import pytest
from evaluated import SECOND, Source, ended, reporting
from live_radars import options
from rclpy.qos import ReliabilityPolicy

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.bags.reader import BagReader


def test_evaluator_publishes_scores_and_writes_the_report(processes, peer, tmp_path):
    _, source, end = reporting(processes, peer, tmp_path)
    true = ([(0.0, 0.0), (5000.0, 0.0)], [0, 1])
    source.send(SECOND, true, ([(300.0, 0.0)], [0]), ([(30.0, 40.0), (5000.0, 0.0)], [0, 1]))
    source.send(2 * SECOND)
    source.scored(4)
    status, text, metrics = end()
    assert status == 0
    assert "GOSPA" in text

    statuses = {
        s.name: diagnostics.values_of(s)
        for m in source.scores
        for s in m.status
        if m.header.stamp.sec == 1
    }
    assert set(statuses) == {
        f"{s}/{k}" for s in ("filtered", "smoothed") for k in ("all", "class_0", "class_1")
    }
    # One of two targets found 300 m off: sqrt((300^2 + 1000^2) / 2).
    expected = np.sqrt((300.0**2 + 1000.0**2) / 2.0)
    assert float(statuses["filtered/all"]["ospa"]) == pytest.approx(expected, rel=1e-6)
    assert (statuses["filtered/all"]["n_true"], statuses["filtered/all"]["n_est"]) == ("2", "1")
    assert float(statuses["smoothed/class_0"]["localization"]) == pytest.approx(50.0, rel=1e-6)
    assert set(statuses["filtered/all"]) == {
        *("ospa", "localization", "cardinality", "n_true", "n_est", "cutoff", "order"),
        *("gospa", "gospa_localization", "missed", "false"),
    }
    # One pair 300 m apart and one missed target.
    expected_gospa = np.sqrt(300.0**2 + 1000.0**2 / 2.0)
    assert float(statuses["filtered/all"]["gospa"]) == pytest.approx(expected_gospa, rel=1e-6)
    assert (statuses["filtered/all"]["missed"], statuses["filtered/all"]["false"]) == ("1", "0")
    assert metrics["scans"] == 2
    assert metrics["filtered"]["all"]["ospa"] == pytest.approx(expected / 2.0, rel=1e-6)
    assert metrics["filtered"]["all"]["confusion"] == [[1, 0, 0], [0, 0, 1], [0, 0, 0]]
    # Without track ids there is no OSPA(2).
    assert metrics["filtered"]["all"]["ospa2"] is None


def test_evaluator_follows_track_ids_and_prints_the_names_of_the_classes(processes, peer, tmp_path):
    words = options(classes="[ship, buoy]")
    evaluator, source, end = reporting(processes, peer, tmp_path, *words)
    place = ([(0.0, 0.0)], [0])
    for second, label in ((1, 7), (2, 8)):
        source.send(second * SECOND, place, (*place, [7]), (*place, [label]))
    source.scored(4)
    status, _, metrics = end()
    assert status == 0
    assert metrics["filtered"]["all"]["ospa2"] == 0.0
    # In the second scan one track is half right, and half a track is too much.
    expected = np.sqrt((500.0**2 + 1000.0**2) / 2.0) / 2.0
    assert metrics["smoothed"]["all"]["ospa2"] == pytest.approx(expected, rel=1e-6)
    assert metrics["class_names"] == ["ship", "buoy"]
    printed = evaluator.log.read_text()
    assert "\u2502 ship " in printed
    assert "class 0" not in printed


def test_evaluator_ends_by_itself_after_the_wanted_scans(processes, peer):
    """Also where simulated time stands still: here there is no /clock."""
    words = options(exit_after_scans=1, use_sim_time=True)
    evaluator = processes.start("evaluator", "--ros-args", *words)
    Source(peer).send(SECOND)
    assert peer.spin_until(lambda: evaluator.poll() is not None)
    assert evaluator.returncode == 0


def test_evaluator_ends_by_itself_where_estimates_have_own_stamps(processes, peer, tmp_path):
    """As of radars that turn: there may be more of them than of the truth's, and smoothed later."""
    words = options(exit_after_scans=3)
    evaluator, source, _ = reporting(processes, peer, tmp_path, *words)

    def send(which, *quarters):
        for quarter in quarters:
            source.send_estimates(which, quarter * SECOND // 4)

    for second in (1, 2, 3):
        source.send_truth(second * SECOND)
    send("filtered", 5, 6, 7, 9)
    send("smoothed", 5, 6, 7)
    source.scored(7)
    source.taken()
    assert evaluator.poll() is None
    send("smoothed", 9)

    assert peer.spin_until(lambda: evaluator.poll() is not None)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert (evaluator.returncode, metrics["scans"], metrics["truth_scans"]) == (0, 4, None)


def test_evaluator_ends_by_itself_where_the_truth_begins_before_the_detections(
    processes, peer, tmp_path
):
    evaluator, source, _ = reporting(processes, peer, tmp_path, *options(exit_after_scans=3))
    for second in (1, 2, 3):
        source.send_truth(second * SECOND)
    source.send_estimates("filtered", 2 * SECOND)
    source.send_estimates("filtered", 3 * SECOND)
    source.send_estimates("smoothed", 2 * SECOND)
    source.scored(3)
    source.taken()
    assert evaluator.poll() is None
    source.send_estimates("smoothed", 3 * SECOND)

    assert peer.spin_until(lambda: evaluator.poll() is not None)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert (evaluator.returncode, metrics["scans"], metrics["truth_scans"]) == (0, 2, 3)


@pytest.mark.parametrize("given", ["", "file/metrics.json", "file", "link", "pipe"])
def test_evaluator_refuses_a_report_that_is_no_place_for_one(processes, tmp_path, given):
    (tmp_path / "file").write_text("{}")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    os.mkfifo(tmp_path / "pipe")
    report = tmp_path / given
    status, text = processes.run("evaluator", "--ros-args", *options(report=report))
    assert status == 2
    assert text.startswith(f"evaluator: report: {report} given, ")
    assert len(text.splitlines()) == 1
    assert (tmp_path / "file").read_text() == "{}"


def test_evaluator_reports_a_report_that_cannot_be_written_at_the_end(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", *options(report=report))
    Source(peer)
    report.mkdir()
    status, text = ended(evaluator)
    assert status == 1
    assert f"report not written: {report}: a directory is there" in text
    assert "Traceback" not in text


def test_evaluator_never_writes_nothing_over_figures_of_before(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    good = '{\n  "filtered": {}\n}\n'
    report.write_text(good)
    evaluator = processes.start("evaluator", "--ros-args", *options(report=report))
    peer.said(evaluator, "waiting")
    status, text = ended(evaluator)
    assert status == 1
    assert f"{report} is still the report of an earlier run" in text
    assert report.read_text() == good


def test_evaluator_in_a_namespace_records_its_own_scores(processes, peer, tmp_path):
    words = ("-r", "__ns:=/alpha", *options(record=tmp_path / "bag"))
    evaluator = processes.start("evaluator", "--ros-args", *words)
    scores = f"/alpha{names.OSPA}"
    source = Source(peer, scores, "/alpha/evaluator")
    source.send(SECOND)
    source.scored(2)
    source.taken()
    assert ended(evaluator)[0] == 0
    assert BagReader(tmp_path / "bag").counts[scores] == 2


def test_evaluator_receives_best_effort_truth_if_asked(processes, peer):
    override = f"qos_overrides.{names.TRUTH}.subscription.reliability:=best_effort"
    processes.start("evaluator", "--ros-args", "-p", override)
    asked = {names.TRUTH: ReliabilityPolicy.BEST_EFFORT}
    for topic in (names.TRUTH, names.estimates("smoothed")):
        assert peer.spin_until(lambda topic=topic: peer.node.count_subscribers(topic))
        (info,) = peer.node.get_subscriptions_info_by_topic(topic)
        assert info.qos_profile.reliability == asked.get(topic, ReliabilityPolicy.RELIABLE)
