# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Start the tracker for your own radars, with the radars' frames and, if wanted, RViz.

ros2 launch phd_jdtc_ros tracker.launch.py params_file:=PATH [namespace:=NAME] [rviz:=true] ...
"""

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from phd_jdtc_ros.tools import launching

PACKAGE = "phd_jdtc_ros"
RESPAWN_DELAY_S = 2.0
# Name, default and description of every argument that is true or false.
FLAGS = {
    "use_sim_time": ("false", "take the time from /clock"),
    "rviz": ("false", "start RViz too"),
    "frames": ("true", "publish the radars' frames; false if another node does"),
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
    "log_level": ("info", "log level of the tracker: debug, info, warn, error or fatal"),
    "enclave": ("", "security enclave of the tracker; none if empty"),
    "respawn_max_retries": ("10", "how often the tracker is started again"),
    "reliable_topics": (
        "",
        "topics of detections to subscribe to reliably, separated by commas",
    ),
}
# The environment variables that name the profiles' file for Fast DDS 2 and Fast DDS 3.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
# Topics of the tracker and of the radars in rviz/demo.rviz.
SHOWN = ("filtered/estimates", "smoothed/estimates", "markers")
SHOWN_DETECTIONS = ("/radar_1/detections", "/radar_2/detections")


def generate_launch_description():
    """Return the arguments, the tracker, the radars' frames and RViz."""
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


def _start(context, share):
    """Check the arguments and the file, and return the processes: none starts if one is wrong."""
    given = {name: LaunchConfiguration(name).perform(context) for name in {**ARGUMENTS, **FLAGS}}
    optional = ["autostart"] if given["autostart"] else []
    flags = launching.booleans({name: given[name] for name in [*FLAGS, *optional]})
    retries = launching.whole("respawn_max_retries", given["respawn_max_retries"])
    namespace = launching.full_namespace(
        context.launch_configurations.get("ros_namespace"), given["namespace"]
    )
    tracker = launching.full_name(namespace, given["node_name"])
    config = launching.load(given["params_file"], tracker)
    profile = f"{share}/config/dds/localhost_only.xml"
    actions = _isolation(context, profile) if flags["localhost_only"] else []
    actions += _tracker(given, flags, namespace, retries)
    actions += _frames(config, namespace) if flags["frames"] else []
    if flags["rviz"]:
        actions.append(_rviz(config, tracker, flags["use_sim_time"], f"{share}/rviz/demo.rviz"))
    return actions


def _isolation(context, profile):
    """Return the environment that keeps DDS on this machine, unless the user has a profile."""
    if any(name in context.environment for name in PROFILE_VARIABLES):
        return [LogInfo(msg="localhost_only: the profile in the environment stays in force")]
    return [SetEnvironmentVariable(name, profile) for name in PROFILE_VARIABLES]


def _tracker(given, flags, namespace, retries):
    """Return the tracker, and what keeps it from being started again without use."""
    own = {name: flags[name] for name in ("use_sim_time", "autostart") if name in flags}
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
    # Before the delay is over: launch itself does not look at the exit status.
    give_up = EmitEvent(event=ShutdownProcess(process_matcher=matches_action(node)))
    ended = OnProcessExit(
        target_action=node,
        on_exit=lambda event, _: None if launching.respawns(event.returncode) else [give_up],
    )
    return [*([RegisterEventHandler(ended)] if flags["respawn"] else []), node]


def _frames(config, namespace):
    """Return publishers of the transforms from the world to the radars, if tf2_ros is installed."""
    try:
        get_package_prefix("tf2_ros")
    except PackageNotFoundError:
        return [LogInfo(msg="tf2_ros is not installed: the radars' frames are not published")]
    return [
        Node(
            package="tf2_ros",
            executable="static_transform_publisher",
            name=f"{radar.name}_frame",
            namespace=namespace,
            arguments=[
                *("--x", str(radar.position[0]), "--y", str(radar.position[1])),
                *("--yaw", str(radar.yaw)),
                *("--frame-id", config.world_frame, "--child-frame-id", source.frame),
            ],
        )
        for radar, source in zip(config.model.radars, config.inputs, strict=True)
    ]


def _rviz(config, tracker, simulated, view):
    # As many radars as the view has displays; these can show point clouds only.
    clouds = [source.topic for source in config.inputs if source.message == "point_cloud"]
    shown = [
        *((f"/tracker/{topic}", f"{tracker}/{topic}") for topic in SHOWN),
        *zip(SHOWN_DETECTIONS, clouds, strict=False),
    ]
    return Node(
        package="rviz2",
        executable="rviz2",
        name="rviz",
        arguments=["-d", view],
        parameters=[{"use_sim_time": simulated}],
        remappings=[(name, topic) for name, topic in shown if name != topic],
    )
