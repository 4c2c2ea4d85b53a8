"""
Start the tracker beside radars of your own, with the radars' frames and RViz if wanted.

ros2 launch phd_jdtc_ros tracker.launch.py params_file:=PATH [namespace:=NAME] [rviz:=true] ...
"""

from pathlib import Path

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, TextSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.tools import params_file

PACKAGE = "phd_jdtc_ros"
RESPAWN_DELAY_S = 2.0
# What rviz/demo.rviz shows of the tracker.
SHOWN = ("filtered/estimates", "smoothed/estimates", "markers")


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
                "namespace", default_value="", description="of the tracker; none if empty"
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="take the time from /clock"
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="start RViz too"),
            DeclareLaunchArgument(
                "respawn", default_value="true", description="start the tracker again if it ends"
            ),
            DeclareLaunchArgument(
                "reliable_topics",
                default_value="",
                description="detections to ask for reliably, separated by commas",
            ),
            OpaqueFunction(function=_tracker, args=[simulated]),
            OpaqueFunction(function=_frames),
            OpaqueFunction(function=_rviz, args=[simulated, f"{share}/rviz/demo.rviz"]),
        ]
    )


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


def _frames(context):
    """Return a publisher of the transform from the world to every radar, where tf2_ros is."""
    try:
        get_package_prefix("tf2_ros")
    except PackageNotFoundError:
        return [LogInfo(msg="tf2_ros is not installed: nobody publishes the radars' frames")]
    path = LaunchConfiguration("params_file").perform(context)
    config = resolve(params_file.load(Path(path)))
    return [
        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            name=f"{radar.name}_frame",
            arguments=[
                *("--x", str(radar.position[0]), "--y", str(radar.position[1])),
                *("--yaw", str(radar.yaw)),
                *("--frame-id", config.world_frame, "--child-frame-id", source.frame),
            ],
        )
        for radar, source in zip(config.model.radars, config.inputs, strict=True)
    ]


def _rviz(context, simulated, view):
    namespace = LaunchConfiguration("namespace").perform(context).strip("/")
    prefix = f"/{namespace}" if namespace else ""
    return [
        Node(
            package="rviz2",
            executable="rviz2",
            name="rviz",
            arguments=["-d", TextSubstitution(text=view)],
            parameters=[simulated],
            remappings=[(f"/tracker/{topic}", f"{prefix}/tracker/{topic}") for topic in SHOWN]
            if prefix
            else [],
            condition=IfCondition(LaunchConfiguration("rviz")),
        )
    ]
