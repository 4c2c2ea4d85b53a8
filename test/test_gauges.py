"""The gauges of the structure count what they say."""

from __future__ import annotations

import ast
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import gauges
from benchmarks.gauges import Module


def _module(name: str, text: str) -> Module:
    return Module(name, Path(name.replace(".", "/") + ".py"), text, ast.parse(text))


def test_imports_are_found_however_they_are_written() -> None:
    names = ["a.b", "a.c", "a.d.e", "a.d"]
    text = "import a.c\nfrom .d import e\ndef f():\n    from .d import name\n"

    assert _module("a.b", text).imported(names) == {"a.c", "a.d.e", "a.d"}


def test_circles_of_imports_are_counted_as_groups() -> None:
    arrows = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a", "e"}, "e": {"d"}, "f": {"a"}}

    assert gauges._count_circles(arrows) == 2


def test_only_module_constants_count() -> None:
    tree = ast.parse("A_B = 1\n_C_D: int = 2\nname = 3\ndef f():\n    E_F = 4\n")

    assert gauges._constants(tree) == ["A_B", "_C_D"]


def test_unpacked_tuples_and_long_signatures_are_found() -> None:
    tree = ast.parse("f(*(a, b), c)\nf(*ab, c)\n")
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    method = ast.parse("def f(self, a, b, *, c=1): ...").body[0]
    assert isinstance(method, ast.FunctionDef)

    assert [gauges._splices_tuple(call) for call in calls] == [True, False]
    assert gauges._parameter_count(method) == 3


def test_a_gauge_above_its_limit_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gauges, "LIMITS", {"files of the product": 2, "returns in a scan": 3})
    monkeypatch.setattr(gauges, "count_sources", lambda _: {"files of the product": 1})
    trace = SimpleNamespace(figures={"returns in a scan": 4})
    monkeypatch.setattr(gauges, "trace_scan", lambda: trace)

    assert gauges.main() == 1
    assert "too much" in capsys.readouterr().out
