# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Imports go one way: between the packages, and between the rooms of the core."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = sorted((ROOT / "phd_jdtc_ros" / "core").rglob("*.py"))
PACKAGE = sorted((ROOT / "phd_jdtc_ros").rglob("*.py"))
ADAPTERS = sorted((ROOT / "msg_adapters").rglob("*.py"))
COMPILED = ("compiled", "compiled_kernel")

BASE = ("arrays", "state_space", "types", "origins")
# Which inner loops are in use, and how numba compiles some.
KERNELS = ("backend", "compiled")
# What an engine is built from, beside the models and the searches.
ENGINE = (
    *BASE,
    *("attributes", "backward", "engine", "fixed_lag", "forward", "reporting", "snapshot", "touch"),
    *("window", "window_snapshot"),
)
# What each room of the core, or module beside the rooms, may import of the others.
ROOMS = {
    "arrays": (),
    "compiled": (),
    "backend": ("compiled",),
    "ellipsoid": ("arrays",),
    "origins": ("arrays",),
    "quoting": (),
    "snapshot": (),
    "state_space": ("arrays",),
    "types": ("arrays", "state_space"),
    "known_aircraft": ("models", "snapshot", "types"),
    "track_numbers": ("arrays", "known_aircraft", "reporting", "types"),
    "scans": ("types",),
    "site": ("arrays", "ellipsoid"),
    "sited_plots": ("arrays", "site"),
    "sectors": ("arrays", "types"),
    "antenna": ("arrays", "types"),
    "horizon": ("arrays",),
    "plot_turns": ("antenna", "types"),
    "biases": ("arrays", "types"),
    "turns": ("antenna", "arrays", "horizon", "scans", "sectors", "types"),
    "turn_history": ("scans", "turns", "types"),
    "late_reports": ("engine", "scans", "types"),
    "renumbering": ("arrays", "origins", "reporting", "types"),
    "region": ("arrays", "models", "reporting", "types"),
    "gathering": ("types",),
    "joinable": ("types",),
    "joint_numbers": ("handover",),
    "track_series": ("gathering", "handover", "types"),
    "joint_picture": (
        *("gathering", "handover", "joint_numbers", "region", "track_series", "types"),
    ),
    "innovations": ("arrays", "models", "types"),
    "handover": ("arrays", "region", "renumbering", "reporting", "types"),
    "watch": ("arrays", "engine", "sectors", "types"),
    "association": (*BASE, *KERNELS),
    "pair_search": (*BASE, *KERNELS),
    "attributes": ("arrays", "sited_plots", "snapshot", "types"),
    "models": (*BASE, "attributes", "pair_search", "sited_plots"),
    "reporting": (*BASE, "models"),
    "reporting_rule": ("arrays", "models"),
    "confirmation": (*BASE, "models", "reporting", "reporting_rule", "snapshot"),
    "engine": (*BASE, "models", "reporting_rule", "snapshot"),
    "window": ("arrays", "state_space"),
    "backward": ("arrays", "window"),
    "poses": ("arrays", "models", "types"),
    "posed_reports": ("poses", "types"),
    "touch": ("arrays", "models", "types", "window"),
    "window_snapshot": ("arrays", "models", "snapshot", "types", "window"),
    "clutter_snapshot": ("models", "snapshot"),
    "forward": (
        *("attributes", "clutter_snapshot", "models", "snapshot", "touch", "types"),
        *("window", "window_snapshot"),
    ),
    "fixed_lag": (
        *("arrays", "known_aircraft", "track_numbers", "types"),
        *("confirmation", "engine", "forward", "models", "renumbering", "reporting"),
        *("reporting_rule", "snapshot", "window", "window_snapshot"),
    ),
    "smc": (*ENGINE, "association", "models", "pair_search"),
    "gaussian": (*ENGINE, *KERNELS, "association", "models", "pair_search"),
    "evaluation": BASE,
    "configuration": (
        *(*BASE, "attributes"),
        *("biases", "engine", "models", "poses", "quoting", "reporting", "reporting_rule"),
        *("antenna", "ellipsoid", "region", "scans", "site", "sited_plots", "smc", "turns"),
        "watch",
    ),
    "simulation": (*BASE, "biases", "configuration", "models", "site", "sited_plots"),
    "tuning": (*BASE, "antenna", "configuration", "models", "plot_turns", "sectors"),
    "registration": (*BASE, "biases", "models", "tuning"),
    "engines": ("backend", "configuration", "engine", "gaussian", "smc"),
    "pipeline": (
        *("configuration", "engine", "engines", "late_reports", "posed_reports", "poses", "scans"),
        *("models", "region", "reporting_rule", "turn_history", "turns", "types", "watch"),
    ),
}
# What each part of the project may import of the others.
PARTS = {
    "core": (),
    "asterix": (),
    "earth": ("core",),
    "msg_adapters": ("core", "earth"),
    "bags": ("core", "earth", "msg_adapters"),
    "exit_status": ("bags", "core"),
    "yaml_files": ("core",),
    "resources": ("bags", "core"),
    "output_files": ("core",),
    "report": ("bags", "core", "earth", "msg_adapters", "output_files"),
    "study": ("core", "output_files", "report"),
    "nodes": (
        *("asterix", "bags", "core", "earth", "exit_status", "msg_adapters", "output_files"),
        *("report", "resources", "yaml_files"),
    ),
    "tools": (
        *("asterix", "bags", "core", "earth", "exit_status", "msg_adapters", "nodes"),
        *("output_files", "report", "resources", "study", "yaml_files"),
    ),
    "api": ("core", "earth", "msg_adapters", "resources", "tools", "yaml_files"),
}


def imported_modules(path):
    """Return the absolute names that a file imports, each `from` name counted as a module too."""
    package = list(path.relative_to(ROOT).with_suffix("").parts)[:-1]
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def room_of(name):
    """Return the room that a module of the core, by its absolute name, is in."""
    parts = name.split(".")
    return parts[2] if parts[:2] == ["phd_jdtc_ros", "core"] and len(parts) > 2 else None


def part_of(name):
    """Return the part of the project that a module is in."""
    parts = name.split(".")
    if parts[0] == "msg_adapters":
        return "msg_adapters"
    return parts[1] if parts[0] == "phd_jdtc_ros" and len(parts) > 1 else None


def module_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def test_imported_modules_resolve_relative_names():
    # Guards the other tests: a parser that saw nothing would let everything pass.
    names = imported_modules(ROOT / "phd_jdtc_ros" / "core" / "smc" / "filter.py")
    core = "phd_jdtc_ros.core"
    assert {"numpy", f"{core}.types.Scan", f"{core}.smc.prediction.predict"} <= names


@pytest.mark.parametrize("path", CORE, ids=module_of)
def test_core_imports_only_numpy_scipy_and_itself(path):
    libraries = {"numpy", "scipy", "numba"} if path.stem in COMPILED else {"numpy", "scipy"}
    for name in imported_modules(path):
        root = name.split(".")[0]
        allowed = root in sys.stdlib_module_names or root in libraries
        assert allowed or room_of(name), f"{path.name} imports {name}"


@pytest.mark.parametrize("path", CORE, ids=module_of)
def test_rooms_of_the_core_import_in_one_direction(path):
    own = room_of(module_of(path))
    if own == "__init__":
        return
    others = {room_of(name) for name in imported_modules(path)} - {own, None}
    assert others <= set(ROOMS[own])


@pytest.mark.parametrize("path", [*PACKAGE, *ADAPTERS], ids=module_of)
def test_parts_of_the_project_import_in_one_direction(path):
    own = part_of(module_of(path))
    if own in ("__init__", "__main__"):
        return
    others = {part_of(name) for name in imported_modules(path)} - {own, None, "__version__"}
    assert others <= set(PARTS[own])


@pytest.mark.parametrize("room", ROOMS)
def test_front_door_of_the_core_names_every_room(room):
    import phd_jdtc_ros.core

    assert room in re.findall(r"\w+", phd_jdtc_ros.core.__doc__)


def test_directions_have_no_circle():
    for table in (ROOMS, PARTS):
        placed = set()
        while len(placed) < len(table):
            free = {room for room, others in table.items() if set(others) <= placed} - placed
            assert free, f"a circle among {set(table) - placed}"
            placed |= free


def test_only_messages_motions_and_the_state_space_know_the_layout_of_a_state():
    layout = {f"phd_jdtc_ros.core.state_space.{axis}" for axis in ("X", "VX", "Y", "VY", "OMEGA")}
    knowing = {module_of(path) for path in PACKAGE if imported_modules(path) & layout}
    assert knowing == {"phd_jdtc_ros.core.models.motion", "phd_jdtc_ros.study.peers.conversion"}


def test_core_loads_without_ros_and_without_numba():
    script = (
        "import importlib, pkgutil, sys\n"
        "sys.modules['numba'] = None\n"
        "import phd_jdtc_ros.core as core\n"
        "names = [m.name for m in pkgutil.walk_packages(core.__path__, core.__name__ + '.')]\n"
        f"names = [name for name in names if name.split('.')[-1] not in {COMPILED}]\n"
        "for name in names: importlib.import_module(name)\n"
        "assert len(names) > 40, names\n"
        "print(*sorted({m.split('.')[0] for m in sys.modules}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"rclpy", "sensor_msgs", "std_msgs", "msg_adapters"}
