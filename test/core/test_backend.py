"""Selection of the inner loops by the environment and the installed packages."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


def chosen_backend(environment, without_numba=False):
    """Return a new interpreter's choice, or the last line of its complaint."""
    hide = "sys.modules['numba'] = None; " if without_numba else ""
    script = f"import sys; {hide}from phd_jdtc_ros.core import backend; print(backend.current())"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PHD_JDTC_KERNELS": environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return (done.stdout or done.stderr).strip().splitlines()[-1]


def test_backend_is_numpy_if_requested():
    assert chosen_backend("numpy") == "numpy"


def test_backend_is_numpy_where_numba_is_missing():
    assert chosen_backend("auto", without_numba=True) == "numpy"


def test_backend_is_numba_where_it_is_installed():
    pytest.importorskip("numba", reason="numba is missing: pip install numba")
    assert chosen_backend("auto") == "numba"


def test_backend_that_is_missing_is_an_error_if_asked_for():
    assert "numba" in chosen_backend("numba", without_numba=True)
    assert "Error" in chosen_backend("numba", without_numba=True)


def test_backend_unknown_is_an_error():
    assert chosen_backend("fortran") == (
        "ValueError: PHD_JDTC_KERNELS: 'fortran' given, must be auto, numpy or numba"
    )
