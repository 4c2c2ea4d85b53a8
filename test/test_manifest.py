"""What `rosdep install` reads names everything that the package starts and imports."""

import ast
import re
import sys

import pytest
from manifest import REQUIREMENTS, ROOT, declared

# Key of a Python package, where it is not python3-NAME; None where there is no key.
KEYS = {
    "asterix": None,
    "libasterix": None,
    "lz4": "mcap-ros2-support",
    "mcap": "mcap-ros2-support",
    "numba": None,  # There is one, for a package that Ubuntu 24.04 does not have
    "plotly": None,
    "pyyaml": "python3-yaml",
    "rosbags": None,  # Only tests need it, and a pip key keeps a package out of an apt release
    "sapient_msg": None,
    "sapient_msg_pydantic": None,
    "setuptools": None,  # Every Python build of colcon has it
    "zstandard": "mcap-ros2-support",
}
# Name of the module of a Python package, where it is another.
MODULES = {"libasterix": "asterix", "pyyaml": "yaml"}
# Imported where they are installed.
OPTIONAL = {
    *("aiohttp", "dask", "distributed", "pyais", "rs1090", "sapient_msg", "shapely", "stonesoup")
}
OWN = {"phd_jdtc_ros", "msg_adapters"}


def keys(names):
    """Return the keys of Python packages, those that have one."""
    return {KEYS.get(name, f"python3-{name}") for name in names} - {None}


def imported(*folders):
    """Return the packages that the files of folders import anywhere."""
    found = set()
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.split(".")[0])
    return found - {*sys.stdlib_module_names}


def test_every_python_dependency_is_declared():
    assert keys(REQUIREMENTS) <= declared("exec_depend")


@pytest.mark.parametrize("path", sorted((ROOT / "launch").glob("*.py")), ids=lambda p: p.name)
def test_every_package_of_a_launch_file_is_declared(path):
    text = path.read_text()
    started = set(re.findall(r'package="(\w+)"', text))
    named = set(re.findall(r"^from (\w+)[\w.]* import", text, re.MULTILINE))
    assert "launch_ros" in named
    assert (started | named) - OWN - sys.stdlib_module_names <= declared("exec_depend")


def test_everything_that_the_tests_use_is_declared():
    files = list((ROOT / "test").rglob("*.py"))
    text = "\n".join(path.read_text() for path in files)
    optional = set(re.findall(r'importorskip\(\s*"((?:ament|launch)_?\w*)', text))
    folders = [path for path in (*ROOT.iterdir(), ROOT / "test" / "helpers") if path.is_dir()]
    own = {path.stem for path in [*files, *(ROOT / "docs" / "tools").glob("*.py"), *folders]}
    known = declared("depend", "exec_depend", "test_depend")
    named = set(re.findall(r"^(?:from|import) (\w+)", text, re.MULTILINE))
    foreign = named - own - sys.stdlib_module_names - known
    assert {"ament_flake8", "launch_testing"} <= optional
    assert {"hypothesis", "rosbags"} <= foreign
    assert optional | keys(foreign) <= known
    # Such keys keep a package out of an apt release.
    assert not [key for key in declared("test_depend") if key.endswith("-pip")]


def test_everything_that_is_imported_is_a_dependency_of_its_own():
    foreign = imported(*OWN) - OWN - declared("depend", "exec_depend")
    assert {"mcap", "lz4", "zstandard"} <= foreign
    assert foreign - OPTIONAL <= {MODULES.get(name, name) for name in REQUIREMENTS}
