"""Trials that count only when the target is detected again."""

import numpy as np
import pytest

from phd_jdtc_ros.core.learned.open_trials import OpenTrials, ReportTrials

CELLS = 4


def trials(label, detected, *, expected=1.0, cell=0, existence=1.0):
    """Return trials for targets in one report, with the same values unless they are given."""
    label = np.asarray(label)

    def column(value):
        return np.broadcast_to(np.asarray(value, dtype=float), label.shape)

    return ReportTrials(
        label,
        np.broadcast_to(cell, label.shape),
        column(expected),
        column(detected),
        column(existence),
    )


def after(steps):
    """Return the open trials after reports, and the sums of those that count."""
    found, total = OpenTrials(), np.zeros((3, CELLS))
    for step in steps:
        found, sums = found.after(step, CELLS)
        total += sums
    return found, total


def lives(rng, probability, targets, after_end):
    """Yield reports of targets that live for 1 to 30 reports and are looked for a while longer."""
    begin, length = rng.integers(0, 50, targets), rng.integers(1, 31, targets)
    for scan in range(90):
        here = np.flatnonzero((scan >= begin) & (scan < begin + length + after_end))
        alive = scan < (begin + length)[here]
        yield trials(here, alive & (rng.random(len(here)) < probability))


@pytest.mark.parametrize("probability", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("after_end", [0, 8])
def test_counted_trials_are_detections_with_the_true_probability(probability, after_end):
    _, (count, _, detected) = after(lives(np.random.default_rng(4), probability, 3000, after_end))
    std = np.sqrt(probability * (1.0 - probability) / count[0])
    assert count[0] > 1e4
    assert abs(detected[0] / count[0] - probability) < 4.0 * std


def test_misses_count_with_the_next_detection_and_the_detection_with_the_one_after_it():
    seen = [1.0, 0.0, 0.0, 1.0]
    _, sums = after([trials([7], [d]) for d in seen])
    np.testing.assert_allclose(sums[:, 0], [3.0, 3.0, 1.0])
    _, sums = after([trials([7], [d]) for d in [*seen, 1.0]])
    np.testing.assert_allclose(sums[:, 0], [4.0, 4.0, 2.0])


def test_shares_of_looks_follow_detection_and_existence():
    left, sums = after([trials([7], [0.0]), trials([7], [0.4])])
    np.testing.assert_allclose(sums[:, 0], [0.4, 0.4, 0.0])
    np.testing.assert_allclose(left.open_share, [0.6, 1.0])
    _, sums = after([trials([7], [0.0]), trials([7], [1.0], existence=0.25)])
    np.testing.assert_allclose(sums[:, 0], [0.25, 0.25, 0.0])
    _, sums = after([trials([7], [0.0], cell=2, expected=0.8), trials([7], [1.0], cell=1)])
    np.testing.assert_allclose(sums, [[0, 0, 1, 0], [0, 0, 0.8, 0], [0, 0, 0, 0]])


def test_looks_wait_for_their_own_target():
    _, sums = after([trials([7], [0.0]), trials([7], [1.0], expected=0.0)])
    np.testing.assert_allclose(sums[:, 0], [1.0, 1.0, 0.0])
    left, sums = after([trials([3, 7], [0.0, 0.0]), trials([7], [1.0])])
    np.testing.assert_allclose(sums[0, 0], 1.0)
    assert left.label.tolist() == [3, 7]
    left, _ = after([trials([3, 5, 7], [0.0, 0.0, 0.0])])
    assert left.of(np.array([3, 7])).label.tolist() == [3, 7]
    left, sums = after([trials([7], [1.0]), *(trials([7], [0.0]) for _ in range(5))])
    assert not sums.any()
    assert len(left) == 6
