from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.core.types import Pose
from phd_jdtc_ros.feed.feed import Feed
from phd_jdtc_ros.feed.tally import Tally

MOVING = {"radar_1.pose": "/ship", "radar_2.pose": "/ship"}


def test_feed_reads_and_counts_an_unreadable_pose_at_once():
    config = build.resolve(MOVING)
    tally = Tally(config)

    def read():
        raise RejectedMessageError("frame", "frame_id is 'odom', must be 'map'")

    assert Feed(config, tally).pose("/ship", read) is None
    assert tally.dropped == {"pose_frame": 1}


def test_feed_counts_a_pose_that_comes_twice_once_for_all_its_radars():
    config = build.resolve(MOVING)
    tally = Tally(config)
    feed = Feed(config, tally)
    for _ in range(2):
        list(feed.pose("/ship", lambda: (10**9, Pose((0.0, 0.0), 0.0))) or ())
    assert tally.dropped.total() == 1
