import estimate_sets
import numpy as np
import pytest

from phd_jdtc_ros.core.tracks.renumbering import match
from phd_jdtc_ros.handover import picture


def estimates(tracks, covariance):
    return estimate_sets.estimates(
        np.zeros((len(tracks), 5)), covariance, track_id=np.array(tracks, dtype=int)
    )


GOOD = np.diag([2500.0, 25.0, 2500.0, 25.0, 1e-6])


@pytest.mark.parametrize("covariance", [GOOD, np.zeros((5, 5))])
def test_tracks_with_numbers_and_covariances_can_be_joined(covariance):
    assert picture.fault_of(estimates([3, 4], covariance)) is None
    assert picture.fault_of(estimates([], covariance)) is None


@pytest.mark.parametrize("axis", range(4))
def test_a_negative_variance_cannot(axis):
    covariance = GOOD.copy()
    # Twice this and the metre of slack are zero: matching would divide by it.
    covariance[axis, axis] = -0.5
    found = estimates([3], covariance)
    with pytest.raises(np.linalg.LinAlgError):
        match(found, found, moving=True)
    assert picture.fault_of(found)[0] == "covariance"
    assert "the covariance of track 3" in picture.fault_of(found)[1]


def test_a_covariance_that_is_rounded_to_single_precision_can():
    rng = np.random.default_rng(5)
    for _ in range(200):
        # Almost singular, and of very different sizes.
        spread = rng.standard_normal((5, 1)) * np.array([[2e4], [300.0], [2e4], [300.0], [0.1]])
        covariance = (spread @ spread.T).astype(np.float32).astype(float)
        assert picture.fault_of(estimates([3], covariance)) is None


CORRELATED = GOOD.copy()
CORRELATED[0, 2] = CORRELATED[2, 0] = 2600.0


@pytest.mark.parametrize(
    ("tracks", "covariance", "reason", "words"),
    [
        ([3], CORRELATED, "covariance", "the covariance of track 3 has a negative eigenvalue"),
        ([0, 3, 0], GOOD, "unlabelled", "2 of 3 targets have track_id 0, must be above 0"),
        ([3, 3], GOOD, "schema", "track_id 3 is given twice, must be once"),
        (range(1, picture.MOST_TARGETS + 2), GOOD, "oversize", "10001 targets, at most 10000"),
    ],
)
def test_estimates_that_cannot_be_joined_are_refused(tracks, covariance, reason, words):
    key, said = picture.fault_of(estimates(tracks, covariance))
    assert key == reason
    assert said.startswith(words)
