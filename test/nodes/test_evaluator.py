import json
import re
import signal

import estimate_sets
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from estimate_sets import states
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from msg_adapters import diagnostics, estimates, names, truth
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types import Truth

SECOND = 1_000_000_000


def targets(stamp_ns, positions, classes):
    return Truth(stamp_ns, states(positions), np.arange(1, len(positions) + 1), np.array(classes))


def found(stamp_ns, positions, classes, labels=None):
    size = len(positions)
    return estimate_sets.estimates(
        states(positions),
        stamp_ns=stamp_ns,
        class_probability=np.eye(2)[classes] if size else np.zeros((0, 2)),
        class_id=np.array(classes, dtype=int),
        track_id=np.zeros(size, dtype=int) if labels is None else np.array(labels),
    )


class Source:
    """Stands where a tracker and a replay would."""

    def __init__(self, peer, scores=names.OSPA, node="/evaluator"):
        self.peer = peer
        self.truth = peer.publisher(PointCloud2, names.TRUTH, 50)
        self.clouds = {
            s: peer.publisher(PointCloud2, names.estimates(s)) for s in ("filtered", "smoothed")
        }
        self.scores = peer.collect(DiagnosticArray, scores)
        everyone = [self.truth, *self.clouds.values()]
        assert peer.spin_until(lambda: all(p.get_subscription_count() for p in everyone))
        assert peer.spin_until(lambda: peer.node.count_publishers(scores))
        self.node = node
        peer.meet(node)

    def send(self, stamp_ns, true, filtered, smoothed):
        self.clouds["filtered"].publish(estimates.to_msg(found(stamp_ns, *filtered), "map"))
        self.send_truth(stamp_ns, true)
        self.clouds["smoothed"].publish(estimates.to_msg(found(stamp_ns, *smoothed), "map"))

    def send_truth(self, stamp_ns, true=([], []), frame="map"):
        self.truth.publish(truth.to_msg(targets(stamp_ns, *true), frame))

    def taken(self):
        """Wait until the evaluator has taken everything; no test sends more on a topic."""
        self.peer.meet(self.node, times=10)


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
    # In the second scan a track that is half right, and half a one too much.
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


def test_evaluator_lives_on_after_a_malformed_cloud(processes, peer):
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.truth.publish(PointCloud2())
    source.clouds["filtered"].publish(PointCloud2())
    source.send(SECOND, ([], []), ([], []), ([], []))

    assert peer.spin_until(lambda: len(source.scores) == 2)
    assert evaluator.poll() is None
    assert "is missing" in evaluator.log.read_text()


def test_evaluator_lives_on_after_foreign_figures_and_leaves_them_out(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    figures = peer.publisher(DiagnosticArray, names.cardinality())
    source = Source(peer)
    assert peer.spin_until(figures.get_subscription_count)
    for step_ms in ("fast", "inf", "nan", "20.0"):
        status = diagnostics.status("tracker/cardinality", {"step_ms": step_ms})
        figures.publish(diagnostics.array(SECOND, [status]))
    source.send(SECOND, ([], []), ([], []), ([], []))
    assert peer.spin_until(lambda: len(source.scores) == 2)
    source.taken()
    evaluator.send_signal(signal.SIGINT)

    assert evaluator.wait(10.0) == 0
    text = evaluator.log.read_text()
    assert "/tracker/cardinality: step_ms is 'fast', must be a finite number" in text
    assert json.loads(report.read_text())["step_ms"]["median"] == 20.0


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


EMPTY = ([], [])


def ended(evaluator):
    """Stop the evaluator; return its exit status and its output without line breaks."""
    evaluator.send_signal(signal.SIGINT)
    return evaluator.wait(30.0), " ".join(evaluator.log.read_text().split())


def test_evaluator_counts_the_scans_that_it_never_received(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    source = Source(peer)
    for second in (1, 2, 3):
        source.send(second * SECOND, EMPTY, EMPTY, EMPTY)
    source.send_truth(4 * SECOND)
    source.clouds["filtered"].publish(estimates.to_msg(found(5 * SECOND, *EMPTY), "map"))
    source.send_truth(5 * SECOND)
    assert peer.spin_until(lambda: len(source.scores) == 7)
    source.taken()
    status, text = ended(evaluator)

    assert status == 0
    assert "1 of 5 scans have no filtered estimates" in text
    assert "2 of 5 scans have no smoothed estimates" in text
    metrics = json.loads(report.read_text())
    assert (metrics["scans"], metrics["truth_scans"]) == (3, 5)
    assert "means over 3 of 5 scans" in text


def test_evaluator_counts_what_was_lost_on_the_way(processes, peer):
    """By the publishers' numbers: here it sleeps while more comes than its queues hold."""
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.send(SECOND, EMPTY, EMPTY, EMPTY)
    assert peer.spin_until(lambda: len(source.scores) == 2)
    evaluator.send_signal(signal.SIGSTOP)
    for second in range(2, 400):
        source.send_truth(second * SECOND)
    evaluator.send_signal(signal.SIGCONT)
    source.send(400 * SECOND, EMPTY, EMPTY, EMPTY)
    assert peer.spin_until(lambda: len(source.scores) == 4)
    status, text = ended(evaluator)

    lost = re.search(rf"(\d+) messages on {names.TRUTH} were lost on the way", text)
    assert status == 0
    assert 200 <= int(lost[1]) <= 398


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        ((), f"neither truth on {names.TRUTH} nor estimates were received"),
        (("filtered",), f"no truth was received on {names.TRUTH}"),
        (("truth",), f"no estimates were received on {names.estimates('filtered')} or "),
        (
            ("truth", "filtered"),
            "no estimates are at a stamp of the truth, or between two that are at most 10 s apart "
            f"({names.TRUTH} begins at 11.500 s, {names.estimates('filtered')} begins at 1.000 s)",
        ),
    ],
    ids=["nothing", "no truth", "no estimates", "no common time"],
)
@pytest.mark.parametrize("wanted", [True, False], ids=["a report is wanted", "none is"])
def test_evaluator_explains_why_nothing_is_scored(processes, peer, tmp_path, sent, reason, wanted):
    words = ("--ros-args", "-p", f"report:={tmp_path / 'metrics.json'}") if wanted else ()
    evaluator = processes.start("evaluator", *words)
    source = Source(peer)
    for second in (1, 2):
        if "truth" in sent:
            source.send_truth((second + 10) * SECOND + SECOND // 2)
        if "filtered" in sent:
            cloud = estimates.to_msg(found(second * SECOND, *EMPTY), "map")
            source.clouds["filtered"].publish(cloud)
    source.taken()
    status, text = ended(evaluator)

    assert f"nothing is scored: {reason}" in text
    assert status == (1 if wanted else 0)


def test_evaluator_warns_while_it_runs_that_no_stamp_fits(processes, peer):
    evaluator = processes.start("evaluator")
    source = Source(peer)
    for second in range(1, 31):
        source.send_truth((second + 60) * SECOND)
        cloud = estimates.to_msg(found(second * SECOND, *EMPTY), "map")
        source.clouds["smoothed"].publish(cloud)
    assert peer.spin_until(
        lambda: "no estimates are at a stamp of the truth" in evaluator.log.read_text()
    )
    assert evaluator.poll() is None


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


def test_evaluator_refuses_clouds_of_another_frame_and_of_classes_that_there_are_not(
    processes, peer
):
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.send_truth(SECOND, frame="odom")
    source.send_truth(2 * SECOND, frame="map")
    source.send_truth(3 * SECOND, ([(0.0, 0.0)], [2]), frame="odom")
    source.clouds["filtered"].publish(estimates.to_msg(found(SECOND, [(0.0, 0.0)], [0]), "odom"))
    source.clouds["filtered"].publish(estimates.to_msg(found(SECOND, *EMPTY), "base_link"))
    assert peer.spin_until(lambda: len(source.scores) == 1)
    source.taken()
    status, text = ended(evaluator)

    assert status == 0
    assert f"{names.TRUTH}: frame_id is 'map', must be 'odom' as in the first cloud" in text
    assert f"2 clouds on {names.TRUTH} were rejected" in text
    assert f"1 clouds on {names.estimates('filtered')} were rejected" in text
    # Only those that fit are of the truth.
    assert "of 1 scans have no smoothed estimates" in text


def test_evaluator_names_the_unknown_class(processes, peer):
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.send_truth(SECOND, ([(0.0, 0.0)], [2]))
    assert peer.spin_until(
        lambda: "must be less than 2, the number of" in evaluator.log.read_text()
    )


def test_evaluator_scores_a_repeated_stamp_once(processes, peer, tmp_path):
    report = tmp_path / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}")
    source = Source(peer)
    for _ in range(3):
        source.send(SECOND, EMPTY, EMPTY, EMPTY)
    source.send(2 * SECOND, EMPTY, EMPTY, EMPTY)
    source.taken()
    assert peer.spin_until(lambda: len(source.scores) >= 4)
    status, text = ended(evaluator)

    assert (status, len(source.scores)) == (0, 4)
    assert json.loads(report.read_text())["scans"] == 2
    assert "6 clouds repeated a stamp" in text
