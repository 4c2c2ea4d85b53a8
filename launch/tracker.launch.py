"""
Start the tracker for your own radars and, if wanted, RViz.

ros2 launch phd_jdtc_ros tracker.launch.py params_file:=PATH [namespace:=NAME] [rviz:=true] ...
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import Action, LaunchContext, LaunchDescription
from phd_jdtc_ros import resources
from phd_jdtc_ros.tools.launching import arguments, failure

PACKAGE = "phd_jdtc_ros"
RESPAWN_DELAY_S = 2.0
# Name, default and description of every argument that is true or false.
FLAGS = {
    "use_sim_time": ("false", "take the time from /clock"),
    "rviz": ("false", "start RViz too"),
    "respawn": ("true", "start the tracker again if it ends, but not after exit status 2"),
    "localhost_only": (
        "false",
        "keep DDS on this machine, with a profile for Fast DDS, for all nodes started after this",
    ),
}
ARGUMENTS = {
    "params_file": ("", "ROS parameter file of the tracker; the defaults if empty"),
    "namespace": ("", "namespace of the tracker; none if empty"),
    "node_name": ("tracker", "name of the tracker"),
    "autostart": ("", "configure and activate the tracker at the start; as in the file if empty"),
    "frames": (
        "",
        "publish the radars' frames, false if another node does; as in the file if empty",
    ),
    "log_level": ("info", "log level of the tracker: debug, info, warn, error or fatal"),
    "enclave": ("", "security enclave of the tracker; none if empty"),
    "respawn_max_retries": ("10", "how often the tracker is started again"),
    "reliable_topics": (
        "",
        "topics of detections to subscribe to reliably, separated by commas",
    ),
}
# Topics of the tracker in rviz/demo.rviz.
SHOWN = ("detections", "filtered/estimates", "smoothed/estimates", "markers")
# Arguments that are true or false, or empty for what the file says.
SWITCHES = ("autostart", "frames")


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, the tracker and RViz."""
    share = get_package_share_directory(PACKAGE)
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, (default, description) in {**ARGUMENTS, **FLAGS}.items()
            ),
            OpaqueFunction(function=_start, args=[share]),
        ]
    )


def _start(context: LaunchContext, share: str) -> list[Action]:
    """Check the arguments and the file, and return the processes: none starts if one is wrong."""
    given = {name: LaunchConfiguration(name).perform(context) for name in {**ARGUMENTS, **FLAGS}}
    switches = [name for name in SWITCHES if given[name]]
    flags = arguments.booleans({name: given[name] for name in [*FLAGS, *switches]})
    retries = arguments.whole("respawn_max_retries", given["respawn_max_retries"])
    namespace = arguments.full_namespace(
        context.launch_configurations.get("ros_namespace"), given["namespace"]
    )
    tracker = arguments.full_name(namespace, given["node_name"])
    # Only to see that it is right, before anything starts.
    arguments.load(given["params_file"], tracker)
    profile = f"{share}/config/dds/localhost_only.xml"
    actions = _isolation(context, profile) if flags["localhost_only"] else []
    actions += _tracker(given, flags, tracker, namespace, retries if flags["respawn"] else 0)
    if flags["rviz"]:
        actions.append(_rviz(tracker, flags["use_sim_time"], f"{share}/rviz/demo.rviz"))
    return actions


def _isolation(context: LaunchContext, profile: str) -> list[Action]:
    """Return the environment that keeps DDS on this machine, unless the user has a profile."""
    if any(name in context.environment for name in resources.PROFILE_VARIABLES):
        return [LogInfo(msg="localhost_only: the profile in the environment stays in force")]
    return [SetEnvironmentVariable(name, profile) for name in resources.PROFILE_VARIABLES]


def _tracker(
    given: Mapping[str, str],
    flags: Mapping[str, bool],
    tracker: str,
    namespace: str,
    retries: int,
) -> list[Action]:
    """Return the tracker, and what ends the launch once it has failed for good."""
    own: dict[str, Any] = {
        name: flags[name] for name in ("autostart", "use_sim_time") if name in flags
    }
    if "frames" in flags:
        own["outputs"] = arguments.outputs(given["params_file"], tracker, flags["frames"])
    reliable = {
        f"qos_overrides.{topic}.subscription.reliability": "reliable"
        for topic in given["reliable_topics"].split(",")
        if topic
    }
    node = Node(
        package=PACKAGE,
        executable="tracker",
        name=given["node_name"],
        namespace=namespace,
        output="screen",
        parameters=[*filter(None, [given["params_file"]]), {**own, **reliable}],
        ros_arguments=[
            *("--log-level", given["log_level"]),
            *(["--enclave", given["enclave"]] if given["enclave"] else []),
        ],
        respawn=flags["respawn"],
        respawn_delay=RESPAWN_DELAY_S,
        respawn_max_retries=retries,
    )
    ends = itertools.count(1)

    def end(event: ProcessExited, context: LaunchContext) -> list[Action] | None:
        """End the launch with the tracker; at its shutdown every status is right."""
        final = arguments.is_final(event.returncode, next(ends), retries)
        if context.is_shutdown or not final:
            return None
        return [EmitEvent(event=failure.Failure(f"{given['node_name']} failed"))]

    ended = OnProcessExit(target_action=node, on_exit=end)
    return [failure.handler(), RegisterEventHandler(ended), node]


def _rviz(tracker: str, simulated: bool, view: str) -> Action:
    shown = [(f"/tracker/{topic}", f"{tracker}/{topic}") for topic in SHOWN]
    return Node(
        package="rviz2",
        executable="rviz2",
        name="rviz",
        arguments=["-d", view],
        parameters=[{"use_sim_time": simulated}],
        remappings=[(name, topic) for name, topic in shown if name != topic],
    )
