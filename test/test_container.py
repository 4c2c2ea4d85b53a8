"""The container's files agree with the package's."""

import json
import re

import pytest
from manifest import REQUIREMENTS, ROOT, declared

TEXT = (ROOT / "Dockerfile").read_text().replace("${DISTRO}", "jazzy")
# Needs a screen.
LEFT_OUT = {"ros-jazzy-rviz2"}
# Tools that build the package, and those in a checkout's .venv.
TOOLS = {"python3-colcon-common-extensions", "python3-pip"}
TEST_TOOLS = {"git", "iproute2", "make", "python3-venv"}
PIP_KEYS = {"mcap-ros2-support"}


def read_stages():
    """Return the instructions of each stage by its name, continued lines joined."""
    lines = re.sub(r"^#.*\n", "", TEXT, flags=re.MULTILINE).replace("\\\n", " ").splitlines()
    found, name = {}, ""
    for line in filter(None, map(str.strip, lines)):
        instruction, _, rest = line.partition(" ")
        if not name and instruction == "ARG":  # A part of the base image's name
            continue
        if instruction == "FROM":
            name = rest.split(" AS ")[1]
        found.setdefault(name, []).append((instruction, " ".join(rest.split())))
    return found


STAGES = read_stages()


def installed(stage, command):
    """Return the packages that a stage installs with apt-get or pip, in their order."""
    (listed,) = [
        re.search(rf"{command} install (.*?)(?: &&|$)", rest)[1]
        for instruction, rest in STAGES[stage]
        if instruction == "RUN" and f"{command} install" in rest
    ]
    words = re.sub(r"-c \S+", "", listed).split()
    return [word for word in words if not word.startswith("-")]


def debian_packages(*kinds):
    """Return the Debian packages of dependencies in package.xml."""
    keys = declared(*kinds) - PIP_KEYS
    python = {key for key in keys if key.startswith("python3-")}
    return python | {f"ros-jazzy-{key.replace('_', '-')}" for key in keys - python}


def test_packages_are_those_of_the_manifest():
    runtime = debian_packages("depend", "exec_depend") - LEFT_OUT | TOOLS
    assert {*installed("dependencies", "apt-get")} == runtime
    of_tests = debian_packages("test_depend") | TEST_TOOLS
    assert {*installed("development", "apt-get")} == of_tests


def test_pip_installs_what_ubuntu_lacks():
    debian = {package.removeprefix("python3-") for package in installed("dependencies", "apt-get")}
    # The first four come with mcap-ros2-support; a ROS installation has the build tools.
    brought = {"mcap", "lz4", "zstandard", "setuptools", "pyyaml"}
    expected = {*REQUIREMENTS} - debian - brought | PIP_KEYS
    assert {*installed("dependencies", "pip")} == expected
    assert declared("depend", "exec_depend") >= PIP_KEYS


@pytest.mark.parametrize("stage", ["development", "runtime"])
def test_container_does_not_run_as_root(stage):
    assert [rest for name, rest in STAGES[stage] if name == "USER"] == ["ubuntu"]


def test_what_git_ignores_stays_out_of_the_image():
    ignored = (ROOT / ".gitignore").read_text().split()
    left_out = {line.removeprefix("**/") for line in (ROOT / ".dockerignore").read_text().split()}
    assert {line.rstrip("/") for line in ignored if line.endswith("/")} <= left_out


def test_containers_open_a_stage_and_run_a_command_that_there_is():
    folder = ROOT / ".devcontainer"
    document = json.loads((folder / "devcontainer.json").read_text())
    assert (folder / document["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert (folder / document["build"]["context"]).resolve() == ROOT
    assert ("USER", document["remoteUser"]) in STAGES[document["build"]["target"]]
    (command,) = [rest for name, rest in STAGES["runtime"] if name == "CMD"]
    assert json.loads(command)[:4] == ["ros2", "run", "phd_jdtc_ros", "demo"]
