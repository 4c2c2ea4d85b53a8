"""First detections of targets, which count as false until later looks show the targets."""

from types import SimpleNamespace

import numpy as np
import pytest

from phd_jdtc_ros.core.factors import ClutterRanges
from phd_jdtc_ros.core.factors.clutter.first_detections import FirstDetections
from phd_jdtc_ros.core.factors.clutter.ranges import NODES

FIRST = FirstDetections(np.array([3, 7, 9]), np.array([1.0, 4.5, 2.0]), np.array([0.9, 0.8, 0.7]))


def look(label, before, after, born=(), born_at=()):
    """Return what a look shows of the existence of targets, and the targets born at it."""
    targets = SimpleNamespace(label=np.array(label), existence=np.array(before))
    born, born_at = (np.array(each, dtype=np.int64) for each in (born, born_at))
    association = SimpleNamespace(existence=np.array(after))
    return SimpleNamespace(targets=targets, association=association, born=born, born_at=born_at)


def test_a_count_falls_with_the_probability_that_the_target_never_existed():
    judged, change = FIRST.judged(look([3, 5, 9], [0.1, 0.5, 0.2], [0.64, 0.9, 0.1]))
    np.testing.assert_allclose(judged.count, [0.9 * 0.4, 0.8, 0.7 * 0.9 / 0.8])
    np.testing.assert_allclose(change, judged.count - FIRST.count)


def test_a_target_that_ends_was_there_all_the_same():
    """Bayes' rule on three hypotheses: it never existed, it exists, or it has ended."""
    survival, detection, born = 0.95, 0.9, 0.2
    never, alive, ended = 1.0 - born, born, 0.0
    first = FirstDetections(np.array([1]), np.zeros(1), np.array([never]))
    # The likelihood ratios of the pair of detections, and misses after it.
    for of_target in [30.0, 30.0, *[1.0 - detection] * 6]:
        alive, ended = survival * alive, ended + (1.0 - survival) * alive
        before = alive
        never, alive, ended = np.array([never, of_target * alive, ended]) / (
            never + of_target * alive + ended
        )
        first, _ = first.judged(look([1], [before], [alive]))
        assert first.count[0] == pytest.approx(never, rel=1e-9)
    assert alive < 1e-4
    assert never < 0.5


def test_those_that_count_next_to_nothing_are_forgotten():
    known = FIRST.fading(1e-3).with_born(
        look([], [], [], [11, 12], [2, 0]), np.arange(3.0), np.array([0.9, 0.8, 0.5])
    )
    assert known.label.tolist() == [11, 12]
    assert known.place.tolist() == [2.0, 0.0]
    assert known.count.tolist() == [0.5, 0.9]


def test_a_law_takes_back_what_a_target_counted():
    law = ClutterRanges.of_table(True, (0.0, 20e3), ((), ()))
    first = FirstDetections(np.array([4]), np.array([NODES - 1.25]), np.array([0.9]))
    counted = law.changed(count=np.ones(NODES), first=first)
    shown = counted.learn_from_others(look([4], [0.1], [0.91]))
    expected = [*np.ones(NODES - 2), 1.0 - 0.25 * 0.81, 1.0 - 0.75 * 0.81]
    np.testing.assert_allclose(shown.count, expected)
    assert shown.log_ratio(np.array([19e3])) < counted.log_ratio(np.array([19e3]))
    assert counted.learn_from_others(look([5], [0.1], [0.91])) is counted
