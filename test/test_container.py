"""The container's files agree with the package's."""

import ast
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "Dockerfile").read_text()
# Needs a screen.
LEFT_OUT = {"ros-jazzy-rviz2"}
# What builds the package, and what is in a checkout's .venv.
TOOLS = {"python3-colcon-common-extensions", "python3-pip"}
TEST_TOOLS = {"git", "iproute2", "make", "python3-venv"}
PIP_KEYS = {"mcap-ros2-support"}


def stages():
    """Return the instructions of each stage by its name, continued lines joined."""
    lines = re.sub(r"^#.*\n", "", TEXT, flags=re.MULTILINE).replace("\\\n", " ").splitlines()
    found, name = {}, ""
    for line in filter(None, map(str.strip, lines)):
        instruction, _, rest = line.partition(" ")
        if instruction == "FROM":
            name = rest.split(" AS ")[1]
        found.setdefault(name, []).append((instruction, " ".join(rest.split())))
    return found


def installed(stage, command):
    """Return the packages that a stage installs with apt-get or pip, in their order."""
    (listed,) = [
        re.search(rf"{command} install (.*?)(?: &&|$)", rest)[1]
        for instruction, rest in stages()[stage]
        if instruction == "RUN" and f"{command} install" in rest
    ]
    words = re.sub(r"-c \S+", "", listed).split()
    return [word for word in words if not word.startswith("-")]


def named_in_manifest(*kinds):
    """Return the Debian packages of dependencies in package.xml, and those that are pip's."""
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {element.text for kind in kinds for element in manifest.findall(kind)}
    debian = {key for key in keys - PIP_KEYS if key.startswith("python3-")}
    ros = {f"ros-jazzy-{key.replace('_', '-')}" for key in keys - PIP_KEYS - debian}
    return debian | ros, keys & PIP_KEYS


def test_packages_are_those_of_the_manifest():
    expected, _ = named_in_manifest("depend", "exec_depend")

    assert {*installed("dependencies", "apt-get")} == expected - LEFT_OUT | TOOLS


def test_development_has_the_packages_that_tests_need():
    expected, _ = named_in_manifest("test_depend")

    assert {*installed("development", "apt-get")} == expected | TEST_TOOLS


def test_pip_installs_what_ubuntu_lacks():
    _, keys = named_in_manifest("depend", "exec_depend")
    tree = ast.parse((ROOT / "setup.py").read_text())
    (required,) = [
        ast.literal_eval(keyword.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        for keyword in node.keywords
        if keyword.arg == "install_requires"
    ]
    names = {re.split(r"[<>=]", entry)[0] for entry in required}
    debian = {package.removeprefix("python3-") for package in installed("dependencies", "apt-get")}
    # mcap-ros2-support brings these; a ROS installation has the build tools.
    brought = {"mcap", "lz4", "zstandard", "setuptools", "pyyaml"}

    assert {*installed("dependencies", "pip")} == names - debian - brought | keys


@pytest.mark.parametrize("stage", ["dependencies", "development"])
def test_packages_are_sorted_and_leave_no_lists(stage):
    packages = installed(stage, "apt-get")
    (run,) = [rest for name, rest in stages()[stage] if name == "RUN" and "apt-get" in rest]

    assert packages == sorted(packages)
    assert run.startswith("apt-get update && ")
    assert "--no-install-recommends" in run
    assert "rm -rf /var/lib/apt/lists/*" in run


@pytest.mark.parametrize("stage", ["development", "runtime"])
def test_container_does_not_run_as_root(stage):
    users = [rest for name, rest in stages()[stage] if name == "USER"]

    assert users == ["ubuntu"]


def test_what_git_ignores_stays_out_of_the_image():
    ignored = (ROOT / ".gitignore").read_text().split()
    left_out = {line.removeprefix("**/") for line in (ROOT / ".dockerignore").read_text().split()}
    folders = {line.rstrip("/") for line in ignored if line.endswith("/")}

    assert folders <= left_out


def test_development_container_opens_a_stage_that_there_is():
    document = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    folder = ROOT / ".devcontainer"

    assert (folder / document["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert (folder / document["build"]["context"]).resolve() == ROOT
    assert document["build"]["target"] in stages()
    assert ("USER", document["remoteUser"]) in stages()[document["build"]["target"]]


def test_first_command_is_one_of_the_package():
    (command,) = [rest for name, rest in stages()["runtime"] if name == "CMD"]

    assert json.loads(command)[:4] == ["ros2", "run", "phd_jdtc_ros", "demo"]
