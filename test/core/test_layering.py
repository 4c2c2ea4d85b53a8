# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = sorted((ROOT / "phd_jdtc_ros" / "core").rglob("*.py"))
ADAPTERS = sorted((ROOT / "msg_adapters").rglob("*.py"))


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
            names |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return names


def within(name, package):
    return name == package or name.startswith(package + ".")


def test_imported_modules_resolve_relative_names():
    # Guards the other tests: a parser that saw nothing would let everything pass.
    names = imported_modules(ROOT / "phd_jdtc_ros" / "core" / "engine.py")
    assert {"typing", "phd_jdtc_ros.core.types", "phd_jdtc_ros.core.types.Scan"} <= names


# The one file that may import an optional library, and is imported only if that is there.
COMPILED = "compiled"


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_core_imports_only_numpy_scipy_and_itself(path):
    libraries = {"numpy", "scipy", "numba"} if path.stem == COMPILED else {"numpy", "scipy"}
    for name in imported_modules(path):
        root = name.split(".")[0]
        allowed = root in sys.stdlib_module_names or root in libraries
        assert allowed or within(name, "phd_jdtc_ros.core"), f"{path.name} imports {name}"


@pytest.mark.parametrize("path", ADAPTERS, ids=lambda path: path.stem)
def test_adapters_import_neither_nodes_nor_study(path):
    for name in imported_modules(path):
        assert not within(name, "phd_jdtc_ros.nodes"), f"{path.name} imports {name}"
        assert not within(name, "phd_jdtc_ros.study"), f"{path.name} imports {name}"


def test_core_loads_without_ros_and_without_numba():
    script = (
        "import importlib, pkgutil, sys\n"
        "sys.modules['numba'] = None\n"
        "import phd_jdtc_ros.core as core\n"
        "names = [m.name for m in pkgutil.walk_packages(core.__path__, core.__name__ + '.')]\n"
        f"names = [name for name in names if not name.endswith('.{COMPILED}')]\n"
        "for name in names: importlib.import_module(name)\n"
        "assert len(names) > 15, names\n"
        "print(*sorted({m.split('.')[0] for m in sys.modules}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"rclpy", "sensor_msgs", "std_msgs", "msg_adapters"}
