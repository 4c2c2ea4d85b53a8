"""Silence against an enumeration of phases and losses, and the learned priors."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from scipy.linalg import expm

from phd_jdtc_ros.core.reports import silence

INTERVAL_S, LOST = 10.0, 0.2
IN_SIGHT = silence.Losses(LOST)


def _silent(time_s: float, phases: np.ndarray) -> float:
    """Return the probability of silence: all transmissions in (0, t] were lost, by the phase."""
    count = np.floor((time_s - phases) / INTERVAL_S).astype(int) + 1
    return float(np.mean(LOST ** count.astype(float)))


@pytest.mark.parametrize("off", [0.05, 0.3, 0.7])
def test_silence_equals_the_enumeration_of_phases_at_any_times(off):
    rng = np.random.default_rng(5)
    phases = (np.arange(200_000) + 0.5) / 200_000 * INTERVAL_S
    for time_s in np.cumsum(rng.uniform(0.1, 9.0, 12)):
        quiet = silence.unheard(np.array([time_s]), np.array([INTERVAL_S]), IN_SIGHT)
        dark, _ = silence.judge(np.ones(1), off, np.array([False]), quiet, np.zeros(1))
        by_phase = _silent(time_s, phases)
        assert dark[0] == pytest.approx(off / (off + (1.0 - off) * by_phase), abs=1e-5)


def test_silence_after_a_report_counts_whole_intervals():
    quiet = silence.since_report(np.array([0.0, 9.9, 10.1, 35.0]), np.full(4, INTERVAL_S), IN_SIGHT)
    np.testing.assert_allclose(quiet, [1.0, 1.0, LOST, LOST**3])


HIDING = silence.Losses(LOST, hidden=0.1, hidden_s=15.0)


def _paths(count: int, begins: float) -> Iterator[tuple[bool, float]]:
    """Yield each path through so many reports, all lost: if it was ever hidden, and how likely."""
    # Rates of hiding and of showing again, which keep the share of the time.
    shows = 1.0 / HIDING.hidden_s
    hides = shows * HIDING.hidden / (1.0 - HIDING.hidden)
    chain = expm(INTERVAL_S * np.array([[-hides, hides], [shows, -shows]]))
    lost = np.array([LOST, 1.0])
    for states in itertools.product((0, 1), repeat=count + 1):
        p = begins if states[0] else 1.0 - begins
        for before, after in itertools.pairwise(states):
            p *= chain[before, after] * lost[after]
        # Of those that were not hidden the next report is received or lost while in sight.
        yield any(states), p * (chain[states[-1], 0] * (1.0 - LOST))


@pytest.mark.parametrize("begins", [0.0, 0.1])
def test_reports_lost_in_a_row_are_as_many_as_of_all_states_of_hiding(begins):
    for count in range(5):
        more = sum(p for _, p in _paths(count, begins))
        number, every = np.array([count, count + 1.0]), np.full(2, INTERVAL_S)
        row = HIDING.in_row(number, every, begins)
        assert row[0] - row[1] == pytest.approx(more, rel=1e-9)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_lost_reports_tell_whether_the_transmitter_was_hidden_as_all_paths_do(count):
    paths = [*_paths(count, 0.0)]
    right = sum(p for hidden, p in paths if hidden) / sum(p for _, p in paths)
    found = HIDING.hiding(np.array([float(count)]), np.array([INTERVAL_S]))
    assert found[0] == pytest.approx(right, rel=1e-9)


def test_no_lost_report_says_nothing_of_hiding():
    assert HIDING.hiding(np.zeros(1), np.array([INTERVAL_S]))[0] == 0.0


@pytest.mark.parametrize("time_s", [4.0, 25.0, 90.0, 600.0])
def test_a_heard_transmitter_was_switched_off_before_its_next_report_came(time_s):
    step_s = 0.01
    # The time at which it was switched off, each with the silence until then.
    off_s = np.arange(0.5 * step_s, time_s, step_s)
    silent = silence.since_report(off_s, np.full(len(off_s), INTERVAL_S), HIDING)
    off = silence.SWITCHED_OFF * step_s * silent.sum()
    own = np.array([time_s]), np.array([INTERVAL_S])
    quiet = silence.since_report(*own, HIDING)
    dark, _ = silence.judge(np.ones(1), 0.1, np.ones(1, bool), quiet, HIDING.unnoticed_s(*own))
    assert dark[0] == pytest.approx(off / (off + (1.0 - off) * quiet[0]), rel=1e-4)


def test_judge_says_no_more_than_the_obligation():
    quiet, never = np.full(3, 1e-9), np.full(3, False)
    dark, silent = silence.judge(np.array([0.0, 0.4, 1.0]), 0.1, never, quiet, np.zeros(3))
    assert dark[0] == 0.0
    # All are certainly silent; of the second, 0.04 to 0.57 are obliged and off.
    np.testing.assert_allclose(silent, 1.0, atol=1e-6)
    assert dark[1] == pytest.approx(0.4 * 0.1 / (0.4 * 0.1 + 0.6 * 0.95), abs=1e-6)
    assert dark[2] == pytest.approx(1.0, abs=1e-6)
