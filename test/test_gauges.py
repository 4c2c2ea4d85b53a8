"""The gauges of the structure count what they say."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks import gauges


def test_a_gauge_above_its_limit_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gauges, "LIMITS", {"files of the product": 2, "returns in a scan": 3})
    monkeypatch.setattr(gauges, "count_sources", lambda _: {"files of the product": 1})
    trace = SimpleNamespace(figures={"returns in a scan": 4})
    monkeypatch.setattr(gauges, "trace_scan", lambda: trace)

    assert gauges.main() == 1
    assert "too much" in capsys.readouterr().out
