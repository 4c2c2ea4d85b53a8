"""Layering beyond the import contracts of `pyproject.toml`, which `make check` runs."""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import phd_jdtc_ros.core

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "phd_jdtc_ros"
CORE = sorted((PACKAGE / "core").rglob("*.py"))


def module_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


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


def test_imported_modules_resolve_relative_names():
    # Guards the other tests: a parser that saw nothing would let everything pass.
    names = imported_modules(PACKAGE / "core" / "window" / "forward_filter.py")
    core = "phd_jdtc_ros.core"
    assert {"numpy", f"{core}.types.Scan", f"{core}.gaussian.prediction.survivors"} <= names


def test_core_imports_only_numpy_scipy_and_itself():
    faults = []
    for path in CORE:
        libraries = {"numpy", "scipy"} | ({"numba"} if path.stem == "compilation" else set())
        for name in imported_modules(path):
            root = name.split(".")[0]
            own = name.startswith("phd_jdtc_ros.core.")
            if not (own or root in sys.stdlib_module_names or root in libraries):
                faults.append(f"{path.name} imports {name}")
    assert faults == []


def contracts():
    """Return the import contracts by their names."""
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    linter = tomllib.loads(text)["tool"]["importlinter"]
    return {contract["name"]: contract for contract in linter["contracts"]}


def test_every_part_of_the_project_has_a_layer():
    # The core's contracts are `exhaustive` by themselves, which needs a container.
    layers = contracts()["The parts of the project import downwards"]["layers"]
    placed = {name for layer in layers for name in layer.split(" | ")}
    parts = {
        f"phd_jdtc_ros.{path.stem}"
        for path in PACKAGE.iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    others = {"msg_adapters", "studies"}
    assert parts - {"phd_jdtc_ros.__init__", "phd_jdtc_ros.__main__"} == placed - others


def test_front_door_of_the_core_names_every_room():
    core = PACKAGE / "core"
    packages = {path.parent.name for path in core.glob("*/__init__.py")}
    rooms = packages | {path.stem for path in core.glob("*.py")} - {"__init__"}
    assert rooms <= set(re.findall(r"\w+", phd_jdtc_ros.core.__doc__))


def test_no_folder_has_more_than_a_screen_of_modules():
    tops = ("benchmarks", "msg_adapters", "phd_jdtc_ros", "robustness", "studies", "test")
    folders = Counter(path.parent for top in tops for path in (ROOT / top).rglob("*.py"))
    assert folders[PACKAGE / "core"] > 5
    assert {str(folder) for folder, modules in folders.items() if modules > 14} == set()


def test_only_motions_know_the_layout_of_a_state():
    layout = {f"phd_jdtc_ros.core.state_space.{axis}" for axis in ("X", "VX", "Y", "VY", "OMEGA")}
    files = (path for path in PACKAGE.rglob("*.py") if "state_space" in path.read_text())
    knowing = {module_of(path) for path in files if imported_modules(path) & layout}
    motions = {f"phd_jdtc_ros.core.targets.{name}" for name in ("motion", "turn_matrix")}
    assert knowing == motions


def test_core_loads_without_ros_and_without_numba():
    script = (
        "import importlib, pkgutil, sys\n"
        "sys.modules['numba'] = None\n"
        "import phd_jdtc_ros.core as core\n"
        "names = [m.name for m in pkgutil.walk_packages(core.__path__, core.__name__ + '.')]\n"
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


def test_named_tuples_have_no_other_base():
    # Python 3.10 refuses to define one that is generic, which 3.11 allows.
    faults = [
        f"{module_of(path)}.{node.name}"
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and len(node.bases) > 1
        if any(isinstance(base, ast.Name) and base.id == "NamedTuple" for base in node.bases)
    ]
    assert faults == []
