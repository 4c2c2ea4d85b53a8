"""The gate that compares the time of a step with that of another commit."""

import pytest

from benchmarks import gate


def test_ratio_is_the_median_over_the_rounds_of_one_machine():
    # The machine was half as fast in the second round, for both.
    assert gate.ratio([1.1, 2.2, 1.4], [1.0, 2.0, 1.0]) == pytest.approx(1.1)


@pytest.mark.parametrize(("now", "status"), [(1.3, 1), (1.1, 0)])
def test_main_fails_if_an_engine_is_slower_than_allowed(monkeypatch, capsys, now, status):
    monkeypatch.setattr(gate, "seconds", lambda source, _: now if source == gate.ROOT else 1.0)
    assert gate.main(["HEAD"]) == status
    assert f"gaussian: {now:.2f} times" in capsys.readouterr().out


def test_seconds_times_the_public_names():
    assert 0.0 < gate.seconds(gate.ROOT, "gaussian") < 60.0
