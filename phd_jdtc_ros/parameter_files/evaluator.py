"""The parameters of the evaluator node."""

from __future__ import annotations

from msg_adapters import names
from phd_jdtc_ros.configuration.parameters import MOST_CLASSES
from phd_jdtc_ros.configuration.radar_parameters import POSE_MESSAGES
from phd_jdtc_ros.configuration.schema import SMALL, Parameter

TABLE = (
    Parameter("tracker", names.TRACKER, "Full name of the tracker node."),
    Parameter("truth_topic", names.TRUTH, "Topic of the truth."),
    Parameter("world_frame", "map", "Frame of the truth and of the estimates."),
    Parameter("classes", 2, "Number of target classes.", 1, MOST_CLASSES),
    Parameter(
        "class_names",
        [],
        "Names of the classes in the tables, in order; class 0 and so on if empty.",
        element=str,
    ),
    Parameter("cutoff", 1000.0, "OSPA's c, m.", SMALL),
    Parameter(
        "least_speed",
        0.0,
        "Slower targets are not scored, nor the estimates of them, m/s: those that the tracker "
        "takes for clutter, see clutter_map_speed.",
        0.0,
        1e3,
    ),
    Parameter("order", 2.0, "OSPA's p.", 1.0, 100.0),
    Parameter(
        "publish_plots", True, "Publish ~/plot/..., one number per topic for plotting tools."
    ),
    Parameter("report", "", "Path of the final report (JSON); none if empty."),
    Parameter("record", "", "Directory of a bag of everything published; none if empty."),
    Parameter(
        "radar_topics",
        [names.detections("radar_1"), names.detections("radar_2")],
        "Detections to record too.",
        element=str,
    ),
    Parameter(
        "pose_topics",
        [],
        "Poses of what carries radars that move, to record too.",
        element=str,
    ),
    Parameter(
        "pose_message",
        "odometry",
        "Message type of pose_topics. odometry: nav_msgs/Odometry; pose_stamped: "
        "geometry_msgs/PoseStamped.",
        choices=POSE_MESSAGES,
    ),
    Parameter(
        "exit_after_scans",
        0,
        "End once this many stamps are smoothed and scored; where the estimates come in a time of "
        "their own, once the truth has this many and they are. 0 never.",
        0,
        10**9,
    ),
)
