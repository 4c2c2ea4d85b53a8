"""What an evaluator does with clouds that are missing, lost, repeated or refused."""

import json
import re
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from evaluated import EMPTY, SECOND, Source, ended, found
from sensor_msgs.msg import PointCloud2

from msg_adapters import diagnostics, estimates, names


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
    ("sent", "wanted", "reason"),
    [
        ((), True, f"neither truth on {names.TRUTH} nor estimates were received"),
        (("filtered",), False, f"no truth was received on {names.TRUTH}"),
        (("truth",), False, f"no estimates were received on {names.estimates('filtered')} or "),
        (
            ("truth", "filtered"),
            True,
            "no estimates are at a stamp of the truth, or between two that are at most 10 s apart "
            f"({names.TRUTH} begins at 11.500 s, {names.estimates('filtered')} begins at 1.000 s)",
        ),
    ],
    ids=["nothing", "no truth", "no estimates", "no common time"],
)
def test_evaluator_explains_why_nothing_is_scored(processes, peer, tmp_path, sent, wanted, reason):
    """It fails only if a report is wanted."""
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


def test_evaluator_names_the_unknown_class(processes, peer):
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.send_truth(SECOND, ([(0.0, 0.0)], [2]))
    assert peer.spin_until(
        lambda: "must be less than 2, the number of" in evaluator.log.read_text()
    )
