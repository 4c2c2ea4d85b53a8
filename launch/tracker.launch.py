# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Start the tracker for your own radars, with the radars' frames and, if wanted, RViz.

ros2 launch phd_jdtc_ros tracker.launch.py params_file:=PATH [namespace:=NAME] [rviz:=true] ...
"""

from pathlib import Path

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import (
    DeclareLaunchArgument,
    LogInfo,
    OpaqueFunction,
    SetEnvironmentVariable,
)
from launch.substitutions import LaunchConfiguration, TextSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from phd_jdtc_ros.tools import tracker_params

PACKAGE = "phd_jdtc_ros"
RESPAWN_DELAY_S = 2.0
# The environment variables that name the profiles' file for Fast DDS 2 and Fast DDS 3.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
# Topics of the tracker and of the radars in rviz/demo.rviz.
SHOWN = ("filtered/estimates", "smoothed/estimates", "markers")
SHOWN_DETECTIONS = ("/radar_1/detections", "/radar_2/detections")


def generate_launch_description():
    """Return the arguments, the tracker, the radars' frames and RViz."""
    share = get_package_share_directory(PACKAGE)
    simulated = {
        "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=f"{share}/config/paper_scenario.yaml",
                description="ROS parameter file of the tracker",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of the tracker; none if empty"
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="take the time from /clock"
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="start RViz too"),
            DeclareLaunchArgument(
                "frames",
                default_value="true",
                choices=["true", "false"],
                description="publish the radars' frames; false if another node does",
            ),
            DeclareLaunchArgument(
                "respawn", default_value="true", description="start the tracker again if it ends"
            ),
            DeclareLaunchArgument(
                "reliable_topics",
                default_value="",
                description="topics of detections to subscribe to reliably, separated by commas",
            ),
            DeclareLaunchArgument(
                "localhost_only",
                default_value="false",
                choices=["true", "false"],
                description="keep DDS on this machine, with a profile for Fast DDS, for all nodes "
                "started after this",
            ),
            # First, because it affects only what is started after it.
            OpaqueFunction(function=_isolation, args=[f"{share}/config/dds/localhost_only.xml"]),
            OpaqueFunction(function=_tracker, args=[simulated]),
            OpaqueFunction(function=_frames),
            OpaqueFunction(function=_rviz, args=[simulated, f"{share}/rviz/demo.rviz"]),
        ]
    )


def _isolation(context, profile):
    """Return the environment that keeps DDS on this machine, unless the user has a profile."""
    if LaunchConfiguration("localhost_only").perform(context) != "true":
        return []
    if any(name in context.environment for name in PROFILE_VARIABLES):
        return [LogInfo(msg="localhost_only: the profile in the environment stays in force")]
    return [SetEnvironmentVariable(name, profile) for name in PROFILE_VARIABLES]


def _tracker(context, simulated):
    topics = LaunchConfiguration("reliable_topics").perform(context).split(",")
    reliable = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable" for topic in topics if topic
    }
    return [
        Node(
            package=PACKAGE,
            executable="tracker",
            name="tracker",
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            parameters=[
                LaunchConfiguration("params_file"),
                simulated,
                *([reliable] if reliable else []),
            ],
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=RESPAWN_DELAY_S,
        )
    ]


def _config(context):
    return tracker_params.load(Path(LaunchConfiguration("params_file").perform(context)))


def _frames(context):
    """Return publishers of the transforms from the world to the radars, if tf2_ros is installed."""
    if LaunchConfiguration("frames").perform(context) != "true":
        return []
    try:
        get_package_prefix("tf2_ros")
    except PackageNotFoundError:
        return [LogInfo(msg="tf2_ros is not installed: the radars' frames are not published")]
    config = _config(context)
    return [
        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            name=f"{radar.name}_frame",
            namespace=LaunchConfiguration("namespace"),
            arguments=[
                *("--x", str(radar.position[0]), "--y", str(radar.position[1])),
                *("--yaw", str(radar.yaw)),
                *("--frame-id", config.world_frame, "--child-frame-id", source.frame),
            ],
        )
        for radar, source in zip(config.model.radars, config.inputs, strict=True)
    ]


def _rviz(context, simulated, view):
    if LaunchConfiguration("rviz").perform(context) != "true":
        return []
    namespace = LaunchConfiguration("namespace").perform(context).strip("/")
    tracker = "/".join(["", *filter(None, [namespace]), "tracker"])
    # As many radars as the view has displays; these can show point clouds only.
    clouds = [source.topic for source in _config(context).inputs if source.message == "point_cloud"]
    shown = [
        *((f"/tracker/{topic}", f"{tracker}/{topic}") for topic in SHOWN),
        *zip(SHOWN_DETECTIONS, clouds, strict=False),
    ]
    return [
        Node(
            package="rviz2",
            executable="rviz2",
            name="rviz",
            arguments=["-d", TextSubstitution(text=view)],
            parameters=[simulated],
            remappings=[(name, topic) for name, topic in shown if name != topic],
        )
    ]
