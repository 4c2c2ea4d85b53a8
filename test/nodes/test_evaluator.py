import json
import signal

import numpy as np
import pytest
from evaluated import EMPTY, SECOND, Source, ended, found
from rclpy.qos import ReliabilityPolicy

from msg_adapters import diagnostics, estimates, names
from phd_jdtc_ros.bags.reader import BagReader


def test_evaluator_publishes_scores_and_writes_the_report(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    source = Source(peer)
    true = ([(0.0, 0.0), (5000.0, 0.0)], [0, 1])
    source.send(SECOND, true, ([(300.0, 0.0)], [0]), ([(30.0, 40.0), (5000.0, 0.0)], [0, 1]))
    source.send(2 * SECOND, ([], []), ([], []), ([], []))
    assert peer.spin_until(lambda: len(source.scores) == 4)
    evaluator.send_signal(signal.SIGINT)
    assert evaluator.wait(10.0) == 0
    metrics = json.loads(report.read_text())

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
    assert metrics["filtered"]["all"]["gospa"] == pytest.approx(expected_gospa / 2.0, rel=1e-6)
    assert metrics["filtered"]["all"]["position_detection"] == 0.5
    assert metrics["filtered"]["all"]["confusion"] == [[1, 0, 0], [0, 0, 1], [0, 0, 0]]
    # The missed target's one scan; without track ids there is no OSPA(2).
    assert metrics["filtered"]["class_1"]["long_gap_misses"] == 0.0
    assert metrics["filtered"]["all"]["ospa2"] is None
    assert "GOSPA" in evaluator.log.read_text()
    assert metrics["class_accuracy"] == 1.0
    assert metrics["smoothed"]["all"]["cardinality_abs_error"] == 0.0


def test_evaluator_follows_track_ids(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    source = Source(peer)
    for second, label in ((1, 7), (2, 8)):
        source.send(
            second * SECOND,
            ([(0.0, 0.0)], [0]),
            ([(0.0, 0.0)], [0], [7]),
            ([(0.0, 0.0)], [0], [label]),
        )
    assert peer.spin_until(lambda: len(source.scores) == 4)
    evaluator.send_signal(signal.SIGINT)
    assert evaluator.wait(10.0) == 0
    metrics = json.loads(report.read_text())

    assert metrics["filtered"]["all"]["ospa2"] == 0.0
    # In the second scan one track is half right, and half a track is too much.
    expected = np.sqrt((500.0**2 + 1000.0**2) / 2.0) / 2.0
    assert metrics["smoothed"]["all"]["ospa2"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("simulated", ["false", "true"])
def test_evaluator_ends_by_itself_after_the_wanted_scans(processes, peer, simulated):
    """Also where simulated time stands still: here there is no /clock."""
    evaluator = processes.start(
        *("evaluator", "--ros-args", "-p", "exit_after_scans:=1"),
        *("-p", f"use_sim_time:={simulated}"),
    )
    source = Source(peer)
    source.send(SECOND, ([], []), ([], []), ([], []))

    assert peer.spin_until(lambda: evaluator.poll() is not None)
    assert evaluator.returncode == 0


def test_evaluator_ends_by_itself_where_estimates_have_stamps_of_their_own(
    processes, peer, tmp_path
):
    """As of radars that turn: there may be more of them than of the truth's, and smoothed later."""
    report = tmp_path / "metrics.json"
    words = ("-p", "exit_after_scans:=3", "-p", f"report:={report}")
    evaluator = processes.start("evaluator", "--ros-args", *words)
    source = Source(peer)

    def send(which, *quarters):
        for quarter in quarters:
            cloud = estimates.to_msg(found(quarter * SECOND // 4, *EMPTY), "map")
            source.clouds[which].publish(cloud)

    for second in (1, 2, 3):
        source.send_truth(second * SECOND)
    send("filtered", 5, 6, 7, 9)
    send("smoothed", 5, 6, 7)
    assert peer.spin_until(lambda: len(source.scores) == 7)
    source.taken()
    assert evaluator.poll() is None
    send("smoothed", 9)

    assert peer.spin_until(lambda: evaluator.poll() is not None)
    metrics = json.loads(report.read_text())
    assert (evaluator.returncode, metrics["scans"], metrics["truth_scans"]) == (0, 4, None)


@pytest.mark.parametrize("given", ["", "file/metrics.json"], ids=["directory", "below a file"])
def test_evaluator_refuses_a_report_that_cannot_be_written(processes, tmp_path, given):
    (tmp_path / "file").touch()
    report = tmp_path / given
    status, text = processes.run("evaluator", "--ros-args", "-p", f"report:={report}")

    assert status == 2
    assert text.startswith(f"evaluator: report: {report} given, ")
    assert len(text.splitlines()) == 1


def test_evaluator_reports_a_report_that_cannot_be_written(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    Source(peer)
    report.mkdir()
    evaluator.send_signal(signal.SIGINT)

    assert evaluator.wait(10.0) == 1
    text = evaluator.log.read_text()
    assert f"report not written: {report}: Is a directory" in text
    assert "Traceback" not in text


def test_evaluator_in_a_namespace_records_its_own_scores(processes, peer, tmp_path):
    evaluator = processes.start(
        *("evaluator", "--ros-args", "-r", "__ns:=/alpha", "-p", f"record:={tmp_path / 'bag'}")
    )
    scores = f"/alpha{names.OSPA}"
    source = Source(peer, scores, "/alpha/evaluator")
    source.send(SECOND, ([], []), ([], []), ([], []))
    assert peer.spin_until(lambda: len(source.scores) == 2)
    source.taken()
    evaluator.send_signal(signal.SIGINT)

    assert evaluator.wait(10.0) == 0
    assert BagReader(tmp_path / "bag").counts[scores] == 2


def test_evaluators_help_explains_how_to_set_parameters(processes):
    status, text = processes.run("evaluator", "--help")

    assert (status, "-p NAME:=VALUE" in text) == (0, True)


def test_evaluator_receives_best_effort_truth_if_asked(processes, peer):
    override = f"qos_overrides.{names.TRUTH}.subscription.reliability:=best_effort"
    processes.start("evaluator", "--ros-args", "-p", override)
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.TRUTH))

    (info,) = peer.node.get_subscriptions_info_by_topic(names.TRUTH)
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert peer.spin_until(lambda: peer.node.count_subscribers(names.estimates("smoothed")))
    (other,) = peer.node.get_subscriptions_info_by_topic(names.estimates("smoothed"))
    assert other.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_evaluator_refuses_qos_that_there_is_not(processes):
    override = f"qos_overrides.{names.TRUTH}.subscription.reliability:=perfect"
    status, text = processes.run("evaluator", "--ros-args", "-p", override)

    assert status == 2
    assert f"evaluator: qos_overrides.{names.TRUTH}" in text
    assert "Traceback" not in text


def test_evaluator_prints_the_names_of_the_classes(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    options = ("-p", "classes:=[ship, buoy]", "-p", f"report:={report}")
    evaluator = processes.start("evaluator", "--ros-args", *options)
    source = Source(peer)
    source.send(SECOND, *[([(0.0, 0.0)], [0])] * 3)
    assert peer.spin_until(lambda: len(source.scores) == 2)
    evaluator.send_signal(signal.SIGINT)
    assert evaluator.wait(10.0) == 0

    assert json.loads(report.read_text())["class_names"] == ["ship", "buoy"]
    printed = evaluator.log.read_text()
    assert "\u2502 ship " in printed
    assert "class 0" not in printed


def test_evaluator_never_writes_nothing_over_the_figures_of_an_earlier_run(processes, tmp_path):
    report = tmp_path / "metrics.json"
    report.write_text("good")
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    while "waiting" not in evaluator.log.read_text():
        assert evaluator.poll() is None
    status, text = ended(evaluator)

    assert status == 1
    assert f"{report} is still the report of an earlier run" in text
    assert report.read_text() == "good"
