import json

import numpy as np
import pytest
from scipy.stats import chi2

from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.consistency import (
    EXPECTED_OUTSIDE,
    FORGOTTEN,
    NO_AGE,
    TrackAges,
    band,
    mahalanobis2,
)
from phd_jdtc_ros.evaluation.run_scores import Evaluation

RIGHT = np.array([[900.0, 500.0], [500.0, 400.0]])
TARGETS, SCANS = 40, 25
PLACES = np.stack([np.arange(TARGETS) * 5e3, np.zeros(TARGETS)], axis=1)
LABELS = np.arange(1, TARGETS + 1)


def evaluated(stated, labels=lambda scan: LABELS, seed=0):
    """Return a run's consistency: errors of the covariance `RIGHT`, `stated(scan)` in estimates."""
    rng = np.random.default_rng(seed)
    evaluation = Evaluation(1, 1000.0, 2.0)
    none = np.zeros(TARGETS, dtype=int)
    for scan in range(SCANS):
        evaluation.add_truth(scan, PointSet(PLACES, none, LABELS))
        for source in SOURCES:
            found = PLACES + rng.multivariate_normal([0.0, 0.0], RIGHT, TARGETS)
            estimate = PointSet(found, none, labels(scan), None, stated(scan))
            evaluation.add_estimates(source, scan, estimate)
    return evaluation.summary()


def same(covariance):
    return lambda scan: np.tile(covariance, (TARGETS, 1, 1))


def test_right_covariances_have_a_nees_of_one_and_the_expected_share_outside():
    found = evaluated(same(RIGHT))["consistency"]
    for source in SOURCES:
        of_all = found[source]
        low, high = of_all["nees_band_95"]
        assert of_all["pairs"] == TARGETS * SCANS
        # Per pair, twice the value is chi-square distributed with two degrees of freedom.
        assert (low, high) == pytest.approx(chi2.ppf([0.025, 0.975], 2000) / 2000.0)
        # Five standard deviations of the mean, and of the share.
        assert of_all["nees"] == pytest.approx(1.0, abs=5.0 / np.sqrt(1000.0))
        outside = 5.0 * np.sqrt(EXPECTED_OUTSIDE / 1000.0)
        assert of_all["outside_3_sigma"] == pytest.approx(EXPECTED_OUTSIDE, abs=outside)


def test_shares_and_correlations_are_those_of_mahalanobis_distances():
    assert pytest.approx(0.0111, abs=1e-4) == EXPECTED_OUTSIDE
    mirrored = RIGHT * np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert evaluated(same(mirrored))["consistency"][SMOOTHED]["nees"] > 2.0
    error = np.array([[30.0, -7.0], [0.0, 0.0]])
    expected = error[0] @ np.linalg.inv(RIGHT) @ error[0]
    assert mahalanobis2(error, np.stack([RIGHT, RIGHT])) == pytest.approx([expected, 0.0])
    assert np.isnan(mahalanobis2(error, None)).all()


@pytest.mark.parametrize(("factor", "least", "most"), [(0.25, 3.5, 4.5), (4.0, 0.2, 0.3)])
def test_wrong_covariances_are_outside_the_band(factor, least, most):
    found = evaluated(same(factor * RIGHT))["consistency"][FILTERED]
    low, high = found["nees_band_95"]
    assert least < found["nees"] < most
    assert not low <= found["nees"] <= high
    # A quarter of the covariance: exp(-9 / 8) = 32 % outside.
    expected = float(np.exp(-4.5 * factor))
    assert found["outside_3_sigma"] == pytest.approx(expected, abs=0.08)


def test_covariances_of_young_tracks_alone_are_seen_by_age():
    def stated(scan):
        return same(RIGHT / (9.0 if scan < 5 else 1.0))(scan)

    summary = evaluated(stated)
    ages = summary["consistency"][SMOOTHED]["by_age"]
    assert [*ages] == ["0-4", "5-9", "10+"]
    assert [ages[key]["pairs"] for key in ages] == [5 * TARGETS, 5 * TARGETS, 15 * TARGETS]
    assert ages["0-4"]["nees"] > 6.0
    assert ages["0-4"]["outside_3_sigma"] > 0.4
    for key in ("5-9", "10+"):
        low, high = ages[key]["nees_band_95"]
        assert low - 0.1 < ages[key]["nees"] < high + 0.1
    figures = summary["smoothed"]["all"]
    assert figures["nees_age_0_4"] == pytest.approx(ages["0-4"]["nees"])
    assert figures["outside_3_sigma_age_10_up"] == pytest.approx(ages["10+"]["outside_3_sigma"])


def test_estimates_without_covariances_or_labels_have_no_consistency_or_age():
    found = evaluated(lambda scan: None)["consistency"][FILTERED]
    expected = {"pairs": 0, "nees": None, "nees_band_95": None, "outside_3_sigma": None}
    by_age = found.pop("by_age")
    assert found == expected
    assert all(part == expected for part in by_age.values())
    found = evaluated(same(RIGHT), lambda scan: 0 * LABELS)["consistency"][SMOOTHED]
    assert found["pairs"] == TARGETS * SCANS
    assert all(part["pairs"] == 0 for part in found["by_age"].values())
    assert evaluated(same(RIGHT), lambda scan: None)["consistency"][SMOOTHED] == found


@pytest.mark.parametrize(
    "unusable", [0.0 * RIGHT, -RIGHT, np.ones((2, 2)), np.full((2, 2), np.nan), RIGHT * np.inf]
)
def test_covariances_that_state_nothing_are_left_out(unusable):
    def stated(scan):
        covariance = same(RIGHT)(scan)
        covariance[::2] = unusable
        return covariance

    summary = evaluated(stated)
    assert summary["consistency"][FILTERED]["pairs"] == TARGETS * SCANS // 2
    assert 0.8 < summary["consistency"][FILTERED]["nees"] < 1.2
    json.dumps(summary, allow_nan=False)


def test_band_holds_the_mean_of_right_covariances_in_95_per_cent():
    rng = np.random.default_rng(1)
    low, high = band(20)
    means = rng.exponential(1.0, (20_000, 20)).mean(axis=1)
    assert ((low <= means) & (means <= high)).mean() == pytest.approx(0.95, abs=0.006)
    assert band(0) is None


def test_ages_count_from_the_first_report_and_begin_again():
    ages = TrackAges()
    assert ages.add(0, np.array([7, 0]), 2).tolist() == [0, NO_AGE]
    assert ages.add(1, np.array([7, 8]), 2).tolist() == [1, 0]
    assert ages.add(2, np.array([8]), 1).tolist() == [1]
    assert ages.add(3, np.array([8, 7]), 2).tolist() == [2, 3]
    assert ages.add(4, None, 2).tolist() == [NO_AGE] * 2
    ages = TrackAges()
    for stamp in range(5):
        ages.add(stamp, np.array([1]), 1)
    assert ages.add(0, np.array([1]), 1).tolist() == [0]
    ages = TrackAges()
    for number in range(1, 1000):
        ages.add(number, np.array([number]), 1)
    assert len(ages._first) == len(ages._last) == FORGOTTEN + 1
