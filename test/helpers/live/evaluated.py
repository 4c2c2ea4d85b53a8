"""Truth and estimates as a replay and a tracker publish them, for an evaluator."""

import json
import signal

import estimate_sets
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from estimate_sets import states
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros.core.types import Truth

SECOND = 1_000_000_000
EMPTY = ([], [])


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

    def send_estimates(self, source, stamp_ns, *estimated, frame="map"):
        self.clouds[source].publish(estimates.to_msg(found(stamp_ns, *(estimated or EMPTY)), frame))

    def scored(self, count):
        assert self.peer.spin_until(lambda: len(self.scores) >= count)

    def send(self, stamp_ns, true=EMPTY, filtered=EMPTY, smoothed=EMPTY):
        self.send_estimates("filtered", stamp_ns, *filtered)
        self.send_truth(stamp_ns, true)
        self.send_estimates("smoothed", stamp_ns, *smoothed)

    def send_truth(self, stamp_ns, true=EMPTY, frame="map"):
        self.truth.publish(truth.to_msg(targets(stamp_ns, *true), frame))

    def taken(self):
        """Wait until the evaluator has taken everything; no test sends more on a topic."""
        self.peer.meet(self.node, times=10)


def reporting(processes, peer, directory, *words, **more):
    """Start an evaluator that writes a report; return it, its inputs, and a function to end it.

    The function returns the exit status, the output without line breaks, and the report.
    """
    report = directory / "metrics.json"
    evaluator = processes.start("evaluator", "--ros-args", "-p", f"report:={report}", *words)
    source = Source(peer, **more)

    def end():
        source.taken()
        return *ended(evaluator), json.loads(report.read_text())

    return evaluator, source, end


def ended(evaluator):
    """Stop the evaluator; return its exit status and its output without line breaks."""
    evaluator.send_signal(signal.SIGINT)
    return evaluator.wait(30.0), " ".join(evaluator.log.read_text().split())
