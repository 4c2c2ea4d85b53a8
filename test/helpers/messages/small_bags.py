"""Small recordings, and what reading them gives."""

import bag_content
from marker_messages import marker_array, pose_array
from mcap.writer import CompressionType
from samples import FRAME, STAMP_NS, detections, estimates, truth

from msg_adapters.encoding import names
from msg_adapters.incoming import detections as detections_adapter
from msg_adapters.targets import truth as truth_adapter
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from robustness.hostile_input.small_chunks import rewritten

RADAR = names.detections("radar_1")
POSES = names.poses("filtered", 0)
MARKERS = "/tracker/markers"
TOPICS = (
    Topic(RADAR, names.CLOUD, depth=50),
    Topic(names.TRUTH, names.CLOUD, depth=50),
    Topic(POSES, names.POSES),
    Topic(MARKERS, names.MARKERS, depth=1, transient_local=True),
)
SECOND = 1_000_000_000


def made():
    """Return (topic, message, log time) of a small recording, in order of time."""
    entries = []
    for index in range(6):
        cloud = detections_adapter.to_msg(detections(), STAMP_NS + index, FRAME)
        entries.append((RADAR, cloud, STAMP_NS + 2 * index * SECOND))
        targets = truth_adapter.to_msg(truth(index), "map")
        entries.append((names.TRUTH, targets, STAMP_NS + (2 * index + 1) * SECOND))
    end = STAMP_NS + 20 * SECOND
    entries.append((POSES, pose_array(estimates(), 0, "map"), end))
    entries.append((MARKERS, marker_array(estimates(), "map", ("a", "b")), end + 1))
    return entries


def write(directory, entries, topics=TOPICS):
    return bag_content.write(directory, topics, entries)


def chunked(directory, source, chunk_size=300, compression=CompressionType.NONE):
    directory.mkdir()
    return rewritten(source, directory / "small_0.mcap", compression, chunk_size)


def types():
    """Return name and type of each topic of the recording."""
    return [(topic.name, topic.type_name) for topic in TOPICS]


def read_all(path):
    return list(BagReader(path).messages())
