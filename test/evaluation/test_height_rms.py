import numpy as np
import pytest

from phd_jdtc_ros.evaluation.comparison import ALL, PairedScan, PointSet
from phd_jdtc_ros.evaluation.run_scores import RunScores

PLACES = np.array([[0.0, 0.0], [5e3, 0.0], [9e3, 0.0]])


def points(height):
    return PointSet(PLACES, np.zeros(3, dtype=np.int64), np.arange(1, 4), height=height)


def rms(true, found):
    scores = RunScores(1, 1000.0, 2.0)
    scores.add(PairedScan.of(10**9, points(true), points(found), 1000.0))
    return scores.figures()[ALL]["height_rms"]


def test_height_rms_is_that_of_the_pairs_whose_heights_are_known():
    true = np.array([1000.0, 2000.0, 3000.0])
    assert rms(true, np.array([1003.0, 1996.0, np.nan])) == pytest.approx(np.sqrt(12.5))


@pytest.mark.parametrize("true", [None, np.full(3, np.nan)])
def test_height_rms_has_no_meaning_without_heights(true):
    assert rms(true, np.zeros(3)) is None
    assert rms(np.zeros(3), true) is None
