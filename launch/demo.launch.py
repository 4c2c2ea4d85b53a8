"""
Replay the shipped bag through the tracker and score it.

ros2 launch phd_jdtc_ros demo.launch.py [bag:=NAME_OR_PATH] [rate:=0.0] [out:=DIR] [rviz:=true] ...
"""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    TimerAction,
)
from launch.event_handlers import OnProcessExit, OnProcessIO
from launch.events import Shutdown
from launch.events.process import ProcessExited, ProcessIO
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import Action, LaunchContext, LaunchDescription
from msg_adapters.encoding import names
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.parameter_files import node_tables
from phd_jdtc_ros.tools.demo.processes import recorded_topics
from phd_jdtc_ros.tools.launching import arguments, failure
from phd_jdtc_ros.tools.launching.failure import Failure

PACKAGE = "phd_jdtc_ros"
# The arguments of the tracker's launch file, with the demo's defaults.
TRACKER_ARGUMENTS = {
    "params_file": ("", "ROS parameter file of the tracker; if empty, that beside the bag"),
    "namespace": ("", "namespace of the tracker and the evaluator; none if empty"),
    "node_name": ("tracker", "name of the tracker"),
    "log_level": ("info", "log level of the tracker: debug, info, warn, error or fatal"),
    "use_sim_time": ("false", "take the time from the replay's /clock"),
    "rviz": ("false", "start RViz too"),
    "frames": ("", "publish the radars' frames; as in the file if empty"),
    "respawn": ("false", "start the tracker again if it ends"),
    "localhost_only": ("true", "keep DDS on this machine, with a profile for Fast DDS"),
}
# After the replay the last scores take a second or two. Without truth the evaluator does not end by
# itself.
FINISH_S = 10.0
# Log text of each of the replay's subscribers once it is ready.
READY = {"tracker": "tracking ", "evaluator": "connected to"}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the three nodes; the launch ends with the evaluator."""
    share = get_package_share_directory(PACKAGE)
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "bag",
                default_value="paper_scenario",
                description="bag to replay: the name of a shipped one, or a path",
            ),
            DeclareLaunchArgument(
                "rate", default_value="0.0", description="rate of the replay; 0 is lock-step"
            ),
            DeclareLaunchArgument(
                "out", default_value="out/launch", description="directory of metrics.json"
            ),
            *(
                DeclareLaunchArgument(name, default_value=value, description=description)
                for name, (value, description) in TRACKER_ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes, args=[share]),
        ]
    )


def _nodes(context: LaunchContext, share: str) -> list[Action]:
    given = {name: LaunchConfiguration(name).perform(context) for name in TRACKER_ARGUMENTS}
    out, bag, rate = (LaunchConfiguration(name).perform(context) for name in ("out", "bag", "rate"))
    flags = arguments.booleans({"use_sim_time": given["use_sim_time"]})
    namespace = arguments.full_namespace(
        context.launch_configurations.get("ros_namespace"), given["namespace"]
    )
    tracker_name = arguments.full_name(namespace, given["node_name"])
    found, params_file, config = arguments.demo(bag, given["params_file"], tracker_name, Path(out))
    scans = BagReader(found).counts[names.TRUTH]
    topics = [*(source.topic for source in config.inputs), *config.radars_by_platform]
    tracker = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(f"{share}/launch/tracker.launch.py"),
        # Nothing may be lost between two nodes that wait for each other.
        launch_arguments={
            **given,
            "params_file": params_file,
            "reliable_topics": ",".join(topics),
        }.items(),
    )
    evaluator = Node(
        package=PACKAGE,
        executable="evaluator",
        name="evaluator",
        namespace=namespace,
        output="screen",
        parameters=[
            {
                "tracker": tracker_name,
                "classes": [kind.name for kind in config.model.modes.classes],
                **recorded_topics(config),
                # Without truth there is nothing to report.
                "report": f"{out}/metrics.json" if scans else "",
                "exit_after_scans": scans,
                "use_sim_time": flags["use_sim_time"],
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
                "bag": str(found),
                "rate": node_tables.rate(rate),
                "flush_service": f"{tracker_name}/flush",
                "subscriber_timeout_s": 60.0,
                "answer_delay_s": config.answer_delay_s,
            }
        ],
        remappings=[(names.estimates("filtered"), names.estimates("filtered", tracker_name))],
    )
    # The evaluator ends by itself once it has seen everything.
    finished = OnProcessExit(target_action=evaluator, on_exit=_end_with)
    ended = OnProcessExit(target_action=replay, on_exit=_end_after)
    handlers = [RegisterEventHandler(h) for h in (finished, ended, _once_heard(replay))]
    # The tracker's launch file sets the environment for all nodes that follow it, and ends the
    # launch if the tracker fails.
    return [failure.handler(), *handlers, tracker, evaluator]


def _once_heard(replay: Action) -> OnProcessIO:
    """Return a handler that starts the replay when tracker and evaluator have found each other."""
    awaited = dict(READY)

    def listen(event: ProcessIO) -> list[Action] | None:
        name = event.process_name.rsplit("-", 1)[0]
        if name not in awaited or awaited[name] not in event.text.decode(errors="replace"):
            return None
        del awaited[name]
        return None if awaited else [replay]

    return OnProcessIO(on_stdout=listen, on_stderr=listen)


def _end_with(event: ProcessExited, context: LaunchContext) -> list[Action]:
    """Shut down, and as a failure if the evaluator has failed."""
    if event.returncode:
        return [EmitEvent(event=Failure("evaluator failed"))]
    return [EmitEvent(event=Shutdown())]


def _end_after(event: ProcessExited, context: LaunchContext) -> list[Action]:
    """Shut down soon after the replay ends, and as a failure at once if it failed."""
    if event.returncode:
        return [EmitEvent(event=Failure("sensor_replay failed"))]
    end = EmitEvent(event=Shutdown(reason="the bag has been played"))
    return [TimerAction(period=FINISH_S, actions=[end])]
