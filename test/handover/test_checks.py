from dataclasses import replace

import estimate_sets
import numpy as np
import pytest

from phd_jdtc_ros.core.tracks.renumbering import match
from phd_jdtc_ros.handover import checks


def estimates(tracks, covariance):
    return estimate_sets.estimates(
        np.zeros((len(tracks), 5)), covariance, track_id=np.array(tracks, dtype=int)
    )


GOOD = np.diag([2500.0, 25.0, 2500.0, 25.0, 1e-6])


@pytest.mark.parametrize("covariance", [GOOD, np.zeros((5, 5))])
def test_tracks_with_numbers_and_covariances_can_be_joined(covariance):
    assert checks.why_not(estimates([3, 4], covariance)) is None
    assert checks.why_not(estimates([], covariance)) is None


@pytest.mark.parametrize("axis", range(4))
def test_a_negative_variance_cannot(axis):
    covariance = GOOD.copy()
    # Twice this and the metre of slack are zero: matching would divide by it.
    covariance[axis, axis] = -0.5
    found = estimates([3], covariance)
    with pytest.raises(np.linalg.LinAlgError):
        match(found, found, moving=True)
    assert checks.why_not(found)[0] == "covariance"
    assert "the covariance of track 3" in checks.why_not(found)[1]


def test_correlations_of_more_than_one_cannot():
    covariance = GOOD.copy()
    covariance[0, 2] = covariance[2, 0] = 2600.0
    assert checks.why_not(estimates([3], covariance))[0] == "covariance"


def test_a_covariance_that_is_rounded_to_single_precision_can():
    rng = np.random.default_rng(5)
    for _ in range(200):
        # Almost singular, and of very different sizes.
        spread = rng.standard_normal((5, 1)) * np.array([[2e4], [300.0], [2e4], [300.0], [0.1]])
        covariance = (spread @ spread.T).astype(np.float32).astype(float)
        assert checks.why_not(estimates([3], covariance)) is None


def test_tracks_without_numbers_cannot():
    reason, words = checks.why_not(estimates([0, 3, 0], GOOD))
    assert reason == "unlabelled"
    assert words.startswith("2 of 3 targets have track_id 0, must be above 0")


def test_two_of_one_number_cannot():
    reason, words = checks.why_not(replace(estimates([4, 3], GOOD), track_id=np.array([3, 3])))
    assert (reason, words) == ("schema", "track_id 3 is given twice, must be once")


def test_more_targets_than_can_be_worked_off_cannot():
    count = checks.MOST_TARGETS + 1
    found = estimates(range(1, count + 1), GOOD)
    assert checks.why_not(found)[0] == "oversize"
