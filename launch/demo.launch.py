"""
Replay the shipped bag through the tracker and score it.

ros2 launch phd_jdtc_ros demo.launch.py [bag:=PATH] [rate:=0.0] [out:=DIR] [rviz:=true] ...
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from msg_adapters import names
from msg_adapters.bag import BagReader
from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.tools import params_file

PACKAGE = "phd_jdtc_ros"
# The tracker's arguments, and what they are here.
TRACKER_ARGUMENTS = {
    "params_file": ("{share}/config/paper_scenario.yaml", "ROS parameter file of the tracker"),
    "namespace": ("", "of the tracker and the evaluator; none if empty"),
    "use_sim_time": ("false", "the tracker takes the time from the replay's /clock"),
    "rviz": ("false", "start RViz too"),
    "respawn": ("false", "start the tracker again if it ends"),
}


def generate_launch_description():
    """Return the arguments and the three nodes; the launch ends with the evaluator."""
    share = get_package_share_directory(PACKAGE)
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "bag", default_value=f"{share}/bags/paper_scenario", description="what is replayed"
            ),
            DeclareLaunchArgument(
                "rate", default_value="0.0", description="of the replay; 0 goes with the tracker"
            ),
            DeclareLaunchArgument(
                "out", default_value="out/launch", description="where metrics.json goes"
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value=value.format(share=share), description=description
                )
                for name, (value, description) in TRACKER_ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes, args=[share]),
        ]
    )


def _nodes(context, share):
    given = {name: LaunchConfiguration(name).perform(context) for name in TRACKER_ARGUMENTS}
    out, bag = (LaunchConfiguration(name).perform(context) for name in ("out", "bag"))
    config = resolve(params_file.load(Path(given["params_file"])))
    topics = [source.topic for source in config.inputs]
    tracker_name = "/".join(["", *filter(None, [given["namespace"].strip("/")]), "tracker"])
    tracker = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(f"{share}/launch/tracker.launch.py"),
        # Nothing may be lost between two nodes that wait for each other.
        launch_arguments={**given, "reliable_topics": ",".join(topics)}.items(),
    )
    evaluator = Node(
        package=PACKAGE,
        executable="evaluator",
        name="evaluator",
        namespace=given["namespace"],
        output="screen",
        # By the wall clock always: it ends after the replay's clock has stopped.
        parameters=[
            {
                "tracker": tracker_name,
                "classes": len(config.model.modes.classes),
                "radar_topics": topics,
                "report": f"{out}/metrics.json",
                "exit_after_scans": BagReader(Path(bag)).counts[names.TRUTH],
            },
        ],
    )
    replay = Node(
        package=PACKAGE,
        executable="sensor_replay",
        name="sensor_replay",
        output="screen",
        parameters=[
            {
                "bag": bag,
                "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                "flush_service": f"{tracker_name}/flush",
                "estimates_topic": names.estimates("filtered", tracker_name),
                "subscriber_timeout_s": 20.0,
                "progress": False,
            }
        ],
    )
    # The evaluator ends by itself once it has seen everything; a replay that gives up ends it too.
    finished = [
        RegisterEventHandler(
            OnProcessExit(target_action=evaluator, on_exit=[EmitEvent(event=Shutdown())])
        ),
        RegisterEventHandler(OnProcessExit(target_action=replay, on_exit=_end_if_failed)),
    ]
    return [evaluator, tracker, replay, *finished]


def _end_if_failed(event, context):
    return [EmitEvent(event=Shutdown(reason="the replay failed"))] if event.returncode else []
