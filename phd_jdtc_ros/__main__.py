"""Start one of the package's executables: ``python -m phd_jdtc_ros NAME [ARGUMENTS]``.

``ros2 run phd_jdtc_ros NAME`` comes here too.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from types import ModuleType

from phd_jdtc_ros.quoting import short
from phd_jdtc_ros.threads import use_one_thread

# Modules and purposes; the modules are in `nodes` or `tools`.
EXECUTABLES = {
    "sensor_replay": ("nodes.replay", "plays a bag's detections and truth"),
    "tracker": ("nodes.tracker.node", "the live node"),
    "evaluator": ("nodes.evaluator", "compares estimates with truth, live"),
    "track_bag": ("tools.track_bag", "offline: bag in, bag with estimates out"),
    "simulate": ("tools.simulate", "a scenario to a bag"),
    "asterix_bridge": (
        "tools.asterix.bridge",
        "recordings of ASTERIX to bags; without arguments the node",
    ),
    "report_bridge": (
        "tools.report_bridge",
        "AIS and ADS-B recordings to bags; without arguments the node",
    ),
    "tune": ("tools.tune", "proposes a configuration from a recording"),
    "register": ("tools.register", "finds the systematic errors of radars in a recording"),
    "compile_engines": ("tools.compile_engines", "compiles the engines ahead of their first start"),
    "report": ("tools.report", "a bag with estimates to a page and pictures"),
    "monte_carlo": ("tools.monte_carlo", "many seeded runs to tables, figures and a summary"),
    "hand_over": (
        "tools.hand_over",
        "joins bags of several trackers; without arguments the node",
    ),
    "picture": ("nodes.picture", "a tracker's live picture in a browser"),
    "demo": ("tools.demo.demo", "the three nodes on the shipped bag, and the report"),
}

# Former executables, which are studies of the repository now.
MOVED = {
    "madap": "madap",
    "registration": "registration",
    "hours": "hours",
    "seam": "handover",
    "autoferry": "autoferry",
}

# Nodes that are started instead of an executable if it is given ROS arguments only, or none.
NODES = {
    "asterix_bridge": "nodes.asterix",
    "report_bridge": "nodes.reports",
    "hand_over": "nodes.hand_over",
}


def run(name: str, argv: Sequence[str] | None = None) -> int:
    """Run an executable and return its exit status; `argv` without its name."""
    # Modules that a ROS installation has, and that the extra `ros` installs.
    ros_packages = {
        *("ament_index_python", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs"),
        *("lifecycle_msgs", "nav_msgs", "rcl_interfaces", "rclpy", "rosgraph_msgs", "sensor_msgs"),
        *("std_msgs", "std_srvs", "visualization_msgs"),
    }
    # Other modules that an executable needs, with the extra that installs them.
    extras = {"aiohttp": "picture"}
    arguments = sys.argv[1:] if argv is None else argv
    use_one_thread()
    path = EXECUTABLES[name][0]
    if name in NODES and (not arguments or arguments[0] == "--ros-args"):
        path = NODES[name]
    try:
        module = _module(path)
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        if missing in extras:
            advice = f"pip install '.[{extras[missing]}]'"
            print(f"{name}: {missing} is not installed: {advice}", file=sys.stderr)
            return 2
        if missing not in ros_packages:
            raise
        print(
            f"{name}: {missing} is not installed; source a ROS 2 installation, or install the "
            "parts of it that are needed with the package: pip install '.[ros]'",
            file=sys.stderr,
        )
        return 2
    status: int = module.main(arguments)
    return status


def _module(path: str) -> ModuleType:
    """Import an executable's module, which takes a second; a signal ends it without a message.

    A node handles signals by itself once it runs.
    """
    node = path.startswith("nodes.")
    # Nothing has begun, so there is nothing to finish. The numbers are those of `exit_status`.
    status = 0 if node else 128 + signal.SIGINT
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda *_: os._exit(status)) for number in numbers}
    # Hardly anything that is imported becomes garbage. To look for it takes a tenth of the time of
    # a start, and as long again at each later collection.
    collects = gc.isenabled()
    gc.disable()
    try:
        module = importlib.import_module(f"phd_jdtc_ros.{path}")
    finally:
        gc.freeze()
        if collects:
            gc.enable()
    if not node:
        for number, handler in before.items():
            signal.signal(number, handler)
    return module


def _usage() -> str:
    width = max(map(len, EXECUTABLES))
    lines = [f"  {name:{width}}  {purpose}" for name, (_, purpose) in EXECUTABLES.items()]
    return "\n".join(["usage: python -m phd_jdtc_ros NAME [ARGUMENTS]", "", *lines])


def main() -> int:
    """Dispatch on the first argument."""
    if len(sys.argv) > 1 and sys.argv[1] in EXECUTABLES:
        return run(sys.argv[1], sys.argv[2:])
    asked = len(sys.argv) > 1 and sys.argv[1] in ("-h", "--help")
    if len(sys.argv) > 1 and not asked:
        now = MOVED.get(sys.argv[1])
        moved = f": it is python -m studies {now} in a checkout" if now else ""
        print(short(f"unknown executable {sys.argv[1]!r}{moved}"), file=sys.stderr)
    print(_usage(), file=sys.stdout if asked else sys.stderr)
    return 0 if asked else 2


def __getattr__(name: str) -> Callable[[], int]:
    """Return the entry point of the installed script of an executable."""
    if name not in EXECUTABLES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return partial(run, name)


if __name__ == "__main__":
    sys.exit(main())
