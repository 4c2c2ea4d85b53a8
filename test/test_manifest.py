"""What `rosdep install` reads names everything that the package starts and imports."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()
# Key of a Python package, where it is not python3-NAME; None where there is no key.
KEYS = {
    "asterix": None,
    "libasterix": None,
    "lz4": "mcap-ros2-support",
    "mcap": "mcap-ros2-support",
    "numba": None,  # there is one, for a package that Ubuntu 24.04 does not have
    "plotly": None,
    "pyyaml": "python3-yaml",
    "rosbags": None,  # for the tests alone, and a pip key keeps a package out of an apt release
    "setuptools": None,  # every Python build of colcon has it
    "zstandard": "mcap-ros2-support",
}
# Name of the module of a Python package, where it is another.
MODULES = {"libasterix": "asterix", "pyyaml": "yaml"}
# Imported where they are installed.
OPTIONAL = {"dask", "distributed", "stonesoup"}


def declared(*tags):
    return {element.text for element in MANIFEST if element.tag in tags}


def requirements():
    """Return the names in setup.py's install_requires."""
    call = next(
        node
        for node in ast.walk(ast.parse((ROOT / "setup.py").read_text()))
        if isinstance(node, ast.keyword) and node.arg == "install_requires"
    )
    return [re.match(r"[\w-]+", text)[0] for text in ast.literal_eval(call.value)]


@pytest.mark.parametrize("name", requirements())
def test_every_python_dependency_is_declared(name):
    key = KEYS.get(name, f"python3-{name}")

    assert key is None or key in declared("exec_depend")


@pytest.mark.parametrize("path", sorted((ROOT / "launch").glob("*.py")), ids=lambda p: p.name)
def test_every_package_of_a_launch_file_is_declared(path):
    text = path.read_text()
    started = set(re.findall(r'package="(\w+)"', text))
    imported = set(re.findall(r"^from (\w+)[\w.]* import", text, re.MULTILINE))
    own = {"phd_jdtc_ros", "msg_adapters", *sys.stdlib_module_names}

    assert "launch_ros" in imported
    assert (started | imported) - own <= declared("exec_depend")


def test_every_ros_package_of_the_tests_is_declared():
    text = "\n".join(path.read_text() for path in (ROOT / "test").rglob("test_*.py"))
    optional = set(re.findall(r'importorskip\(\s*"((?:ament|launch)_?\w*)', text))

    assert {"ament_flake8", "launch_testing"} <= optional
    assert optional <= declared("exec_depend", "test_depend")


def test_what_the_tests_cannot_do_without_is_declared():
    files = list((ROOT / "test").rglob("*.py"))
    imported = {
        name
        for path in files
        for name in re.findall(r"^(?:from|import) (\w+)", path.read_text(), re.MULTILINE)
    }
    own = {path.stem for path in [*files, *(ROOT / "docs" / "tools").glob("*.py")]} | {
        path.name for path in ROOT.iterdir() if path.is_dir()
    }
    ros = declared("depend", "exec_depend", "test_depend")
    foreign = imported - own - sys.stdlib_module_names - ros

    assert {"hypothesis", "rosbags"} <= foreign
    keys = {KEYS.get(name, f"python3-{name}") for name in foreign} - {None}
    assert keys <= declared("exec_depend", "test_depend")


def test_everything_that_is_imported_is_a_dependency_of_its_own():
    imported = set()
    for path in (
        p for part in ("phd_jdtc_ros", "msg_adapters") for p in (ROOT / part).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.split(".")[0])
    own = {"phd_jdtc_ros", "msg_adapters"}
    foreign = imported - own - sys.stdlib_module_names - declared("depend", "exec_depend")

    assert {"mcap", "lz4", "zstandard"} <= foreign
    assert foreign - OPTIONAL <= {MODULES.get(name, name) for name in requirements()}


def test_no_test_needs_a_key_that_keeps_the_package_out_of_an_apt_release():
    assert not [key for key in declared("test_depend") if key.endswith("-pip")]
