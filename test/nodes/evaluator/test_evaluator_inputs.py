"""What an evaluator does with clouds that are missing, lost, repeated or refused."""

import re
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from evaluated import SECOND, Source, ended, reporting
from live_radars import options
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.evaluation.run_scores import Evaluation
from phd_jdtc_ros.nodes.recorder import ReceivedClouds

FILTERED, SMOOTHED = map(names.estimates, ("filtered", "smoothed"))
ONE = ([(0.0, 0.0)], [0])


def test_evaluator_refuses_what_does_not_fit_and_lives_on(processes, peer, tmp_path):
    _, source, end = reporting(processes, peer, tmp_path)
    figures = peer.publisher(DiagnosticArray, names.cardinality())
    assert peer.spin_until(figures.get_subscription_count)
    for step_ms in ("fast", "inf", "nan", "20.0"):
        status = diagnostics.status("tracker/cardinality", {"step_ms": step_ms})
        figures.publish(diagnostics.array(SECOND, [status]))
    # The first fault of a topic is logged.
    source.send_truth(SECOND, frame="odom")
    source.send_truth(3 * SECOND, ([(0.0, 0.0)], [2]), frame="odom")
    source.send_truth(2 * SECOND, frame="map")
    source.taken()
    source.send_estimates("filtered", SECOND, *ONE, frame="odom")
    source.send_estimates("filtered", SECOND, frame="base_link")
    source.clouds["smoothed"].publish(PointCloud2())
    source.scored(1)
    status, text, metrics = end()

    assert status == 0
    for said in (
        "/tracker/cardinality: step_ms is 'fast', must be a finite number",
        f"{names.TRUTH}: class_id is 2, must be less than 2, the number of names in classes",
        f"2 clouds on {names.TRUTH} rejected",
        f"{FILTERED}: frame_id is 'base_link', must be 'odom' as in the first cloud",
        f"1 cloud on {FILTERED} rejected",
        "is missing",
        # Only those that fit are of the truth.
        "of 1 scan has no smoothed estimates",
    ):
        assert said in text
    assert metrics["step_ms"]["median"] == 20.0


def test_evaluator_counts_what_it_never_received_and_what_came_twice(processes, peer, tmp_path):
    _, source, end = reporting(processes, peer, tmp_path)
    for second in (1, 2, 3, 3, 3):
        source.send(second * SECOND)
    source.send_truth(4 * SECOND)
    source.send_estimates("filtered", 5 * SECOND)
    source.send_truth(5 * SECOND)
    source.scored(7)
    status, text, metrics = end()
    assert (status, len(source.scores)) == (0, 7)
    assert "1 of 5 scans have no filtered estimates" in text
    assert "2 of 5 scans have no smoothed estimates" in text
    assert "6 clouds repeated a stamp" in text
    assert (metrics["scans"], metrics["truth_scans"]) == (3, 5)
    assert "means over 3 of 5 scans" in text


def test_evaluator_counts_what_was_lost_on_the_way(processes, peer):
    """By the publishers' numbers: here it sleeps while more comes than its queues hold."""
    evaluator = processes.start("evaluator")
    source = Source(peer)
    source.send(SECOND)
    source.scored(2)
    evaluator.send_signal(signal.SIGSTOP)
    for second in range(2, 400):
        source.send_truth(second * SECOND)
    evaluator.send_signal(signal.SIGCONT)
    source.send(400 * SECOND)
    source.scored(4)
    status, text = ended(evaluator)
    lost = re.search(rf"(\d+) messages? on {names.TRUTH} lost on the way", text)
    assert status == 0
    assert 200 <= int(lost[1]) <= 398


NO_COMMON_TIME = (
    "no estimates are at a stamp of the truth, or between two that are at most 10 s apart "
    f"({names.TRUTH} begins at 11.500 s, {FILTERED} begins at 1.000 s)"
)


@pytest.mark.parametrize(
    ("received", "reason"),
    [
        ({}, f"neither truth on {names.TRUTH} nor estimates were received"),
        ({FILTERED: 1.0}, f"no truth was received on {names.TRUTH}"),
        ({names.TRUTH: 1.0}, f"no estimates were received on {FILTERED} or {SMOOTHED}"),
        ({names.TRUTH: 11.5, FILTERED: 1.0}, NO_COMMON_TIME),
    ],
    ids=["nothing", "no truth", "no estimates", "no common time"],
)
def test_reason_why_nothing_is_scored(received, reason):
    clouds = ReceivedClouds(names.TRUTH, {"filtered": FILTERED, "smoothed": SMOOTHED})
    for topic, second in received.items():
        clouds.take(topic, round(second * SECOND))
    assert clouds.no_score_reason() == f"nothing is scored: {reason}"
    assert clouds.mismatch(Evaluation(2, 1000.0, 2.0, 10)) is None


@pytest.mark.parametrize("wanted", [True, False])
def test_evaluator_warns_that_no_stamp_fits_and_may_fail(processes, peer, tmp_path, wanted):
    words = options(report=tmp_path / "metrics.json") if wanted else ()
    evaluator = processes.start("evaluator", "--ros-args", *words)
    source = Source(peer)
    for second in range(1, 31):
        source.send_truth((second + 60) * SECOND)
        source.send_estimates("smoothed", second * SECOND)
    peer.said(evaluator, "no estimates are at a stamp of the truth")
    assert evaluator.poll() is None
    status, text = ended(evaluator)
    assert "nothing is scored: no estimates are at a stamp" in text
    assert status == (1 if wanted else 0)
