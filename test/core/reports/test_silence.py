"""Silence against an enumeration of phases and losses, and the learned priors."""

from __future__ import annotations

import itertools

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
        said = silence.judge(np.ones(1), off, np.array([False]), quiet, np.array([time_s]))
        by_phase = _silent(time_s, phases)
        assert said.dark[0] == pytest.approx(off / (off + (1.0 - off) * by_phase), abs=1e-5)


def test_silence_after_a_report_counts_whole_intervals():
    quiet = silence.since_report(np.array([0.0, 9.9, 10.1, 35.0]), np.full(4, INTERVAL_S), IN_SIGHT)
    np.testing.assert_allclose(quiet, [1.0, 1.0, LOST, LOST**3])


@pytest.mark.parametrize("begins", [0.0, 0.1])
def test_reports_lost_in_a_row_are_as_many_as_of_all_states_of_hiding(begins):
    losses = silence.Losses(LOST, hidden=0.1, hidden_s=15.0)
    # Rates of hiding and of showing again, which keep the share of the time.
    shows = 1.0 / losses.hidden_s
    hides = shows * losses.hidden / (1.0 - losses.hidden)
    chain = expm(INTERVAL_S * np.array([[-hides, hides], [shows, -shows]]))
    lost = np.array([LOST, 1.0])
    for count in range(5):
        total = 0.0
        for states in itertools.product((0, 1), repeat=count + 1):
            p = begins if states[0] else 1.0 - begins
            for before, after in itertools.pairwise(states):
                p *= chain[before, after] * lost[after]
            total += p
        number, every = np.array([float(count)]), np.array([INTERVAL_S])
        assert losses.in_row(number, every, begins)[0] == pytest.approx(total, rel=1e-9)


def test_judge_says_no_more_than_the_obligation():
    quiet, never = np.full(3, 1e-9), np.full(3, False)
    said = silence.judge(np.array([0.0, 0.4, 1.0]), 0.1, never, quiet, np.full(3, 500.0))
    assert said.dark[0] == 0.0
    # All are certainly silent; of the second, 0.04 to 0.57 are obliged and off.
    np.testing.assert_allclose(said.silent, 1.0, atol=1e-6)
    assert said.dark[1] == pytest.approx(0.4 * 0.1 / (0.4 * 0.1 + 0.6 * 0.95), abs=1e-6)
    assert said.dark[2] == pytest.approx(1.0, abs=1e-6)
