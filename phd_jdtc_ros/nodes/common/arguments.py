"""A node's command line: ROS arguments with their parameter files, and other arguments."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import ArgumentParser, fail
from phd_jdtc_ros.parameter_files import sections, yaml_files
from phd_jdtc_ros.parameter_files.sections import ParameterFile

_EXAMPLES = "--ros-args -p NAME:=VALUE, --params-file FILE, -r FROM:=TO, -r __ns:=/NAME"
# ROS arguments that are refused with advice where they are given as others.
_OF_ROS = ("-p", "--param", "--params-file", "-r", "--remap", "--log-level", "-e", "--enclave")
# rcl's names of arguments that it cannot parse, with their valid forms.
_FORMS = {
    "parameter override rule": "-p NAME:=VALUE",
    "remap rule": "-r FROM:=TO",
    "log level": "--log-level LEVEL or --log-level LOGGER:=LEVEL",
}


def check(name: str, purpose: str, argv: Sequence[str]) -> tuple[ParameterFile, ...]:
    """Show the help if requested, and return the parameter files among the ROS arguments.

    Arguments that are not ROS arguments are refused, because rclpy ignores them silently: a
    parameter file without ``--ros-args`` before it has no effect. Raise `SystemExit` with status 0
    after the help, and with 2 after a refusal.
    """
    parser = ArgumentParser(
        name,
        usage="%(prog)s [-h] [--ros-args ...]",
        # The rest of a node's docstring is for readers of its code.
        description=purpose.partition("\n\n")[0],
        epilog=f"ROS arguments are, for instance: {_EXAMPLES}",
    )
    others, files = split(name, argv)
    parser.parse_args(others)
    return files


def split(name: str, argv: Sequence[str]) -> tuple[list[str], tuple[ParameterFile, ...]]:
    """Return the other arguments, and the parameter files of the ROS arguments.

    Raise `SystemExit` with status 2 after a line for each fault of the ROS arguments.
    """
    try:
        # Files are checked first, because rcl does not name the fault of a file.
        files = sections.given_in(argv)
        others = remove_ros_args([name, *argv])[1:]
        misplaced = [word for word in others if word in _OF_ROS]
        if misplaced:
            raise ConfigError(f"{misplaced[0]}: is a ROS argument, must follow --ros-args")
        return others, files
    except ConfigError as error:
        raise SystemExit(fail(name, error)) from error
    except Exception as error:  # rclpy's own type for this is private
        raise SystemExit(fail(name, ConfigError(rcl_fault(error)))) from error


def rcl_fault(error: Exception) -> str:
    """Return rcl's message about an argument, without the lines of its source."""
    text = re.sub(r", at \S+:\d+", "", " ".join(str(error).split()))
    for kind, form in _FORMS.items():
        found = re.search(f"Couldn't parse {kind}: '(.*)'", text)
        if found:
            hint = yaml_files.EMPTY_STRING if found[1].endswith(":=") else ""
            return f"{yaml_files.one_line(found[1])}: must be {form}{hint}"
    return yaml_files.one_line(text)
