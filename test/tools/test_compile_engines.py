import contextlib

import pytest

from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.tools import compile_engines


def test_both_engines_are_compiled_without_arguments(capsys):
    assert compile_engines.main([]) == OK
    said = capsys.readouterr().out
    assert "particles: ready after" in said
    assert "gaussian: ready after" in said
    with pytest.raises(SystemExit, match="2"):
        compile_engines.main(["everything"])
    assert "unrecognized arguments: everything" in capsys.readouterr().err


def test_without_numba_it_fails_and_says_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(compilation, "numba", None)
    assert compile_engines.main([]) == FAILED
    assert "numba is not installed: pip install numba" in capsys.readouterr().err


def test_a_result_that_is_not_stored_is_a_failure(monkeypatch, capsys):
    monkeypatch.setattr(compilation, "NOT_STORED", ["sums"])
    monkeypatch.setattr(compile_engines, "_beside", contextlib.nullcontext)
    assert compile_engines.main([]) == FAILED
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err
