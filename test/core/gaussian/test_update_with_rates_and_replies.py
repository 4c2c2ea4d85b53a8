"""The update with range rates and known attributes: which pairs count, and what they weigh."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from lone import MEAN, STD, UNREDUCED, lone, mixture_of, updated
from matchings import posterior

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.association import marginals
from phd_jdtc_ros.core.association.evidence import pair_as_reported
from phd_jdtc_ros.core.factors import Factor
from phd_jdtc_ros.core.gaussian.algebra import kalman, range_rate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.tracks import track_numbers
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.core.window.update import update_scan

DETECTION = 0.8
GIVEN = {
    **UNREDUCED,
    "radar.clutter_rate": 5.0,
    "radar.clutter_max_range": 2e4,
    "radar.detection_probability": DETECTION,
}
RATED = {"radar.fields.range_rate": "range_rate", "radar.range_rate_std": 2.0}
# Three targets with one, two and one hypotheses.
ORIGIN = np.array([1, 2, 2, 4])
STAMP_NS = 7 * 10**9


@dataclass(frozen=True)
class Reply:
    """Stands for evidence: of some pairs."""

    log_factor: np.ndarray
    log_clutter: np.ndarray
    log_undetected: np.ndarray
    column: np.ndarray

    def take(self, pairs):
        return replace(self, log_factor=self.log_factor[pairs], column=self.column[pairs])


class Register:
    """Stands for what is known of attributes, by label and detection; it notes its arguments."""

    def __init__(self, factor, clutter):
        self.log_factor, self.log_clutter = np.log(factor), np.log(clutter)
        self.learned, self.newborn, self.stamps = [], [], []

    def pair(self, gate, targets, view):
        return pair_as_reported(gate, view.detections)

    def out_of_gate(self, targets, pairs, view):
        return None

    def evidence(self, targets, pairs, view):
        assert len(self.log_clutter) == len(view)
        assert targets.missed.shape == targets.existence.shape == targets.label.shape
        label = targets.label[targets.target.take(pairs.row)]
        factor = self.log_factor[label, pairs.column]
        return Reply(factor, self.log_clutter, np.zeros(len(view)), pairs.column)

    def after(self, look):
        self.stamps.append(look.view.stamp_ns)
        found = look.association
        if found.evidence is not None:
            self.learned.append((found.evidence.column, found.pair_probability, found.existence))
        if len(look.born):
            self.newborn.append((look.born, look.view.detections.take(look.born_at)))
        return self


class Clutter(Factor):
    """Knows of a hundred times as much clutter."""

    def expect(self, view):
        return view.changed(clutter_rate=100.0 * view.clutter_rate)


def factors_of(config, known=None):
    """Return the factors of a configuration, with what is known of attributes."""
    return new_engine(config).forward.factors.changed(transponders=known)


def hypotheses(config, rng):
    """Return the three targets, near each other."""
    dynamics = Dynamics(config.model)
    single = mixture_of(dynamics, [(1.0, MEAN, STD)])
    mean = single.mean + rng.normal(0.0, [200.0, 10.0, 200.0, 10.0, 0.0], (4, 1, 5))
    weight = np.array([0.9, 0.3, 0.4, 0.5])[:, None, None]
    covariance = np.repeat(single.covariance, 4, axis=0)
    return Mixture(ORIGIN, weight, mean, covariance, dynamics.unknown_snr(4))


def report(radar, rng, **more):
    """Return three detections near the targets."""
    place = radar.measure(MEAN[None]) + rng.standard_normal((3, 2)) * radar.noise_std
    return Detections(place, None, **more)


def evidence_of(config, mixture, detections):
    """Return the log likelihood of each pair over the density of clutter, (H, M)."""
    (radar,) = config.model.radars
    rates = radar.motion_of(detections)
    found = np.empty((len(mixture), len(detections)))
    for row, z in np.ndindex(found.shape):
        one = mixture.mean[row], mixture.covariance[row]
        own = np.array([z])
        seen = Measured(detections.measurement[own], radar.noise_std[None])
        innovation = kalman.innovations(WeightedGaussians.of(*one), radar, seen)
        found[row, z] = innovation.log_likelihood[0]
        if rates is not None:
            later = kalman.update(*one, radar, innovation)
            rated = range_rate.update_rates(*later, radar, rates.take(own))
            found[row, z] += rated.log_likelihood[0]
    return found - View.of(radar, detections).log_clutter


@pytest.mark.parametrize("replies", [False, True], ids=["no replies", "replies"])
@pytest.mark.parametrize("rated", [False, True], ids=["no rates", "rates"])
@pytest.mark.parametrize("seed", range(3))
def test_weights_are_those_of_all_events_with_rates_and_replies(rated, replies, seed, monkeypatch):
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))
    rng = np.random.default_rng(seed)
    config = lone({**GIVEN, **(RATED if rated else {})})
    (radar,) = config.model.radars
    rate = radar.range_rate_of(MEAN[None])[0] + np.array([0.0, 20.0, np.nan])
    seen, mixture = report(radar, rng, range_rate=rate), hypotheses(config, rng)
    factor, clutter, known = np.ones((5, 3)), np.ones(3), None
    if replies:
        # The second target and the first detection contradict each other.
        factor[[1, 2, 4]] = [[3.0, 0.3, 1.0], [1e-13, 2.0, 0.7], [0.2, 1.0, 5.0]]
        clutter[:] = 0.2, 4.0, 1.0
        known = Register(factor, clutter)
    ratio = np.exp(evidence_of(config, mixture, seen)) * factor[ORIGIN] / clutter
    weight, target = mixture.sums.mass, mixture.sums.target
    missed, detected = posterior(
        target, weight, (1.0 - DETECTION) * weight, DETECTION * weight[:, None] * ratio
    )

    branched = updated(config, mixture, seen, factors=factors_of(config, known))[0]
    found = np.zeros((4, 4))
    for row in range(4):
        own = np.flatnonzero(branched.parent == row)
        order = np.argsort(branched.mixture.sums.mass[own])
        found[row, : len(own)] = branched.mixture.sums.mass[own[order][::-1]]
    expected = np.sort(np.column_stack([missed, detected]), axis=1)[:, ::-1]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert len(branched.mixture) == (14 if replies else 16)
    if replies:
        ((column, mass, existence),) = known.learned
        # All pairs but the two that contradict each other.
        np.testing.assert_array_equal(np.bincount(column), [2, 4, 4])
        detecting = [detected[[0, 3], 0], detected[:, 1], detected[:, 2]]
        for z, own in enumerate(detecting):
            np.testing.assert_allclose(np.sort(mass[column == z]), np.sort(own), rtol=1e-9)
        np.testing.assert_allclose(
            existence, np.bincount(target, missed + detected.sum(axis=1)), rtol=1e-9
        )


@pytest.mark.parametrize("rated", [False, True], ids=["no rates", "rates"])
def test_hypothesis_with_a_detection_is_where_that_puts_its_gaussian(rated):
    config = lone({**GIVEN, **(RATED if rated else {})})
    (radar,) = config.model.radars
    mixture = mixture_of(
        Dynamics(config.model), [(0.5, MEAN, STD), (0.5, MEAN * [-1, 1, 1, 1, 1], STD)]
    )
    place = radar.measure(mixture.mean[1]) + np.array([100.0, 0.02])
    seen = Detections(place, None, range_rate=radar.range_rate_of(mixture.mean[1]) + 10.0)
    prior = mixture.mean[1], mixture.covariance[1]
    measured = Measured(place, radar.noise_std[None])
    innovation = kalman.innovations(WeightedGaussians.of(*prior), radar, measured)
    mean, covariance = kalman.update(*prior, radar, innovation)
    if rated:
        later = range_rate.update_rates(mean, covariance, radar, radar.motion_of(seen))
        mean, covariance = later.mean, later.covariance
    found, _ = updated(config, mixture, seen)
    np.testing.assert_array_equal(np.sort(found.parent), [0, 1, 1])
    detected = int(np.argmax(found.mixture.sums.mass * (found.parent == 1)))
    np.testing.assert_allclose(found.mixture.mean[detected], mean, rtol=1e-12)
    np.testing.assert_allclose(found.mixture.covariance[detected], covariance, rtol=1e-12)
    assert np.isfinite(covariance).all()
    for row in np.flatnonzero(np.arange(3) != detected):
        one = found.parent[row]
        np.testing.assert_array_equal(found.mixture.mean[row], mixture.mean[one])
        np.testing.assert_array_equal(found.mixture.covariance[row], mixture.covariance[one])


def pairs_of(config, detections, known=None):
    """Return how many pairs of one target with the detections count."""
    mixture = mixture_of(Dynamics(config.model), [(0.5, MEAN, STD)])
    found, _ = updated(config, mixture, detections, factors=factors_of(config, known))
    return len(found.mixture) - 1


def test_pairs_that_rates_or_replies_make_improbable_are_left_out():
    config = lone({**GIVEN, **RATED})
    (radar,) = config.model.radars
    place = radar.measure(np.stack([MEAN, MEAN]))
    rate = radar.range_rate_of(MEAN[None])[0] + np.array([0.0, 400.0])
    assert pairs_of(config, Detections(place, None)) == 2
    assert pairs_of(config, Detections(place, None, range_rate=rate)) == 1
    assert pairs_of(config, Detections(place, None, range_rate=rate[::-1])) == 1
    config = lone(GIVEN)
    place = config.model.radars[0].measure(MEAN[None])
    for factor, clutter, count in ((1.0, 1.0, 1), (1e-7, 1.0, 0), (1.0, 1e7, 0), (1e-7, 1e-7, 1)):
        known = Register(np.full((1, 1), factor), np.full(1, clutter))
        assert pairs_of(config, Detections(place, None), known) == count


def test_pairs_with_improbable_amplitudes_are_left_out():
    # Clutter is of the lowest amplitudes, and the targets are strong.
    config = lone(
        {
            **GIVEN,
            "amplitude": "memory",
            "radar.detection_probability": 0.0,
            "radar.clutter_rate": 5000.0,
            "target.snr_band_db": [38.0, 40.0],
        }
    )
    place = config.model.radars[0].measure(MEAN[None])
    assert pairs_of(config, Detections(place, np.array([100.0]))) == 1
    assert pairs_of(config, Detections(place, np.array([3.8]))) == 0


# --- A scan of two radars -------------------------------------------------------------------------

TWO_RADARS = {
    **GIVEN,
    "sensors": ["radar", "other"],
    "other.position": [1e4, 0.0],
    "other.detection_probability": DETECTION,
    "other.clutter_rate": 5.0,
    "detection_births.rates": [0.05],
}


def scan_update(config, predicted, survivors, reports, factors=None):
    row = np.arange(len(predicted))
    branched = Branched(predicted, np.where(row < survivors, row, -1))
    steps = GaussianSteps(Dynamics(config.model), new_engine(config).forward.bounds)
    scan, factors = Scan(STAMP_NS, reports), factors or factors_of(config)
    found = update_scan(branched, steps.model.reports(scan), steps, 6.0, 4, factors)
    return found.rows, found.approximate


def test_hypotheses_of_births_have_no_parents():
    config = lone(GIVEN)
    mixture = hypotheses(config, np.random.default_rng(0))
    nothing = Detections(np.zeros((0, 2)), None)
    for survivors in (0, 1, 3, 4):
        branched, approximate = scan_update(config, mixture, survivors, (nothing,))
        same = (branched.mixture.mean[:, None] == mixture.mean).all(axis=(2, 3))
        own = np.nonzero(same)[1]
        np.testing.assert_array_equal(branched.parent, np.where(own < survivors, own, -1))
        assert approximate == 0


def test_scan_counts_the_large_clusters_of_all_radars(monkeypatch):
    config = lone(TWO_RADARS)
    rng = np.random.default_rng(0)
    mixture = hypotheses(config, rng)
    reports = tuple(report(radar, rng) for radar in config.model.radars)
    assert scan_update(config, mixture, 4, reports)[1] == 0
    monkeypatch.setattr(marginals, "MOST_WORK", 0)
    assert scan_update(config, mixture, 4, reports)[1] == 2


def test_scan_tells_what_is_known_its_stamp_and_the_newborn_of_each_radar():
    config = lone(TWO_RADARS)
    nothing = hypotheses(config, np.random.default_rng(0)).take(np.zeros(0, dtype=int))
    places = np.zeros((3, 5))
    places[:, [0, 2]] = [[5e3, 0], [0, 5e3], [5e3, 5e3]]
    reports = tuple(
        Detections(radar.measure(places[own]), None)
        for radar, own in zip(config.model.radars, (slice(2), slice(2, 3)), strict=True)
    )
    known = Register(np.ones((0, 3)), np.ones(2))
    first = track_numbers.first_detected(4)
    known.evidence = lambda *_: None
    branched, _ = scan_update(config, nothing, 0, reports, factors_of(config, known))
    assert known.stamps == [STAMP_NS] * 2
    assert [born.tolist() for born, _ in known.newborn] == [[first, first + 1], [first + 2]]
    for (_, learned), seen in zip(known.newborn, reports, strict=True):
        np.testing.assert_array_equal(learned.measurement, seen.measurement)
    np.testing.assert_array_equal(branched.mixture.sums.label, first + np.arange(3))


@pytest.mark.parametrize("other", [None, Detections(np.zeros((0, 2)), None)])
def test_scan_leaves_to_later_radars_the_births_that_earlier_ones_missed(other):
    config = lone(TWO_RADARS)
    nothing = hypotheses(config, np.random.default_rng(0)).take(np.zeros(0, dtype=int))
    seen = Detections(config.model.radars[1].measure(MEAN[None]), None)
    mass = scan_update(config, nothing, 0, (other, seen))[0].mixture.sums.mass.sum()
    alone = scan_update(config, nothing, 0, (None, seen))[0].mixture.sums.mass.sum()
    missed = 1.0 if other is None else 1.0 - DETECTION
    assert mass / (1.0 - mass) == pytest.approx(missed * alone / (1.0 - alone), rel=1e-9)


def test_scan_goes_by_what_is_known_of_replies_and_of_clutter():
    config = lone(GIVEN)
    rng = np.random.default_rng(0)
    mixture = hypotheses(config, rng)
    seen = report(config.model.radars[0], rng)
    known = Register(rng.uniform(0.2, 5.0, (5, 3)), rng.uniform(0.2, 5.0, 3))
    factors = factors_of(config, known)
    expected = updated(config, mixture, seen, factors=factors)[0]
    branched, _ = scan_update(config, mixture, 4, (seen,), factors)
    np.testing.assert_array_equal(branched.mixture.sums.mass, expected.mixture.sums.mass)
    configured = factors_of(config)
    of_radar = (Clutter(), *configured.by_sensor["radar"])
    factors = configured.changed(by_sensor={"radar": of_radar})
    branched, _ = scan_update(config, mixture, 4, (seen,), factors)
    more = lone({**GIVEN, "radar.clutter_rate": 500.0})
    np.testing.assert_array_equal(
        branched.mixture.sums.mass, updated(more, mixture, seen)[0].mixture.sums.mass
    )
