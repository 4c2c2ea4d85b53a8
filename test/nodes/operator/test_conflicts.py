"""Conflicts of a live tracker: those of the same scans offline, alarms, and acknowledgement."""

import itertools
from functools import partial

import numpy as np
from live_radars import cloud, connected, options, start_tracker
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msg_adapters.incoming.readers import reader_of
from msg_adapters.outgoing import conflicts
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.tally import Tally

# Two of the reference scenario's targets fly side by side, 700 m apart.
GIVEN = {"conflicts.distance": [900.0], "conflicts.horizon_s": 60.0}
SENT = 8


def offline():
    """Return the conflicts that the scans have offline."""
    config = resolve({**GIVEN, "accuracy": "fast", "lag": 2})
    feed, watch, found = Feed(config, Tally(config)), Watch(config.conflicts), []
    for index, radar in itertools.product(range(SENT), range(2)):
        read = partial(reader_of(config.inputs[radar]).from_msg, cloud(index, radar))
        for event in feed.message(radar, partial(read, config.inputs[radar])):
            step, engine = event.step, feed.pipeline.engine
            found.append(watch.step(event.scan.stamp_ns, step.filtered, engine, None, Manual())[0])
    return found


def test_conflicts_are_those_of_the_same_scans_offline_and_alarms_are_acknowledged(processes, peer):
    clouds = peer.collect(PointCloud2, "/tracker/conflicts")
    markers = peer.collect(MarkerArray, "/tracker/conflicts/markers")
    tracker = start_tracker(processes, *options(**GIVEN))
    radars = connected(peer)
    radars.track_all(*range(SENT))
    assert peer.spin_until(lambda: len(clouds) == SENT)
    expected = offline()
    for sent, other in zip(clouds, expected, strict=True):
        found = conflicts.from_msg(sent)
        assert (found.stamp_ns, found.keys) == (other.stamp_ns, other.keys)
        np.testing.assert_allclose(found.probability, other.probability, rtol=1e-6)
        assert found.alarm.tolist() == other.alarm.tolist()
    assert 1 in expected[-1].alarm
    assert "alarm: track " in tracker.log.read_text()
    texts = [marker.text for marker in markers[-1].markers if marker.text]
    assert len(texts) == np.count_nonzero(expected[-1].alarm)
    raised = int(radars.health.values("conflicts")["not_acknowledged"])
    assert raised > 0
    assert radars.ask("acknowledge").message == f"{raised} alarms acknowledged"
    assert radars.health.values("conflicts")["not_acknowledged"] == "0"
    radars.track(SENT)
    assert peer.spin_until(lambda: len(clouds) == SENT + 1)
    assert 2 in conflicts.from_msg(clouds[-1]).alarm


def test_tracker_without_conflicts_has_no_such_topic(radars, peer):
    radars.track_all(0)
    assert not peer.node.count_publishers("/tracker/conflicts")
