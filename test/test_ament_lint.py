"""ament's own linters, where a ROS installation has them."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [str(ROOT / name) for name in ("phd_jdtc_ros", "msg_adapters", "launch", "setup.py")]
TESTS = str(ROOT / "test")


def test_code_passes_ament_flake8():
    linter = pytest.importorskip("ament_flake8.main", reason="ament_flake8 is not installed")
    count, errors = linter.main_with_errors(
        argv=["--config", str(ROOT / "setup.cfg"), *SOURCES, TESTS]
    )
    assert count == 0, "\n".join(errors)


def test_docstrings_pass_ament_pep257():
    linter = pytest.importorskip("ament_pep257.main", reason="ament_pep257 is not installed")
    # Magic methods and constructors are described by their class; ruff checks the imperative mood,
    # which properties are spared.
    style = ["--convention", "numpy", "--add-ignore", "D105", "D107", "D401", "--"]
    assert linter.main(argv=[*style, *SOURCES[:2]]) == 0
