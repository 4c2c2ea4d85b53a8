"""Replay the shipped bag through the tracker and score it.

ros2 launch phd_jdtc_ros demo.launch.py [bag:=PATH] [rate:=0.0] [out:=DIR]
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = "phd_jdtc_ros"
SCANS = 80


def generate_launch_description() -> LaunchDescription:
    share = get_package_share_directory(PACKAGE)
    out = LaunchConfiguration("out")
    reliable = {
        f"qos_overrides./radar_{number}/detections.subscription.reliability": "reliable"
        for number in (1, 2)
    }
    tracker = Node(
        package=PACKAGE,
        executable="tracker",
        name="tracker",
        output="screen",
        parameters=[f"{share}/config/paper_scenario.yaml", reliable],
    )
    evaluator = Node(
        package=PACKAGE,
        executable="evaluator",
        name="evaluator",
        output="screen",
        parameters=[
            {
                "report": PathJoinSubstitution([out, "metrics.json"]),
                "exit_after_scans": SCANS,
            }
        ],
    )
    replay = Node(
        package=PACKAGE,
        executable="sensor_replay",
        name="sensor_replay",
        output="screen",
        parameters=[
            {
                "bag": LaunchConfiguration("bag"),
                "rate": LaunchConfiguration("rate"),
                "flush_service": "/tracker/flush",
                "subscriber_timeout_s": 20.0,
                "progress": False,
            }
        ],
    )
    finished = RegisterEventHandler(
        OnProcessExit(target_action=evaluator, on_exit=[EmitEvent(event=Shutdown())])
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", default_value=f"{share}/bags/paper_scenario"),
            DeclareLaunchArgument("rate", default_value="0.0"),
            DeclareLaunchArgument("out", default_value="out/launch"),
            evaluator,
            tracker,
            replay,
            finished,
        ]
    )
