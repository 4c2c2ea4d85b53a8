"""The update beside the association: what Gaussians are seen, located, born, kept and learned."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
from lone import BANDS, BIRTHS, MEAN, STD, TWO_MOTIONS, UNREDUCED, lone, mixture_of, updated
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import ClutterMap, PolarGrid, limit
from phd_jdtc_ros.core.factors.state import Factors
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.tracks import track_numbers
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.core.window.update import update_scan

NOTHING = Detections(np.zeros((0, 2)), None)
# Limits of the field of view near a target in the direction 0.8 rad at 7 km.
FIELDS = {
    "largest range": {"radar.max_range": 7010.0, "radar.clutter_max_range": 7010.0},
    "least range": {"radar.min_range": 6990.0},
    "field of view": {"radar.fov_deg": [-50.0, np.degrees(0.8014)]},
    "blind sector": {"radar.blind_sectors_deg": [np.degrees(0.8014), 60.0]},
    "p_D by range": {
        "radar.detection_probability": [0.95, 0.1],
        "radar.detection_probability_range": [6800.0, 7200.0],
    },
}


def test_gaussian_is_missed_as_probably_as_its_azimuth_is_measured_in_the_sector():
    config = lone({**UNREDUCED, "radar.detection_probability": 0.7})
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    mixture = mixture_of(dynamics, [(0.5, MEAN, STD)])
    azimuth = radar.measure(MEAN[None])[0, 1]
    # Deviation of the azimuth, by its derivatives at the mean.
    line = MEAN[[0, 2]] - np.asarray(radar.position)
    across = np.array([-line[1], line[0]]) / (line @ line)
    std = np.hypot(np.sqrt((across**2) @ (STD[[0, 2]] ** 2)), radar.azimuth_std)
    sector = Coverage(azimuth + 0.02, 0.5)
    branched, _ = updated(config, mixture, replace(NOTHING, coverage=sector))
    detected = 0.7 * (norm.cdf(0.52 / std) - norm.cdf(0.02 / std))
    missed = 0.5 * (1.0 - detected)
    np.testing.assert_allclose(branched.mixture.sums.mass, missed / (0.5 + missed), rtol=1e-6)


def test_gaussian_is_detected_with_the_probability_at_its_range():
    table = {"detection_probability": [0.9, 0.1], "detection_probability_range": [0.0, 2e4]}
    config = lone({**UNREDUCED, **{f"radar.{name}": value for name, value in table.items()}})
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    far = MEAN + np.array([5e3, 0.0, 5e3, 0.0, 0.0])
    mixture = mixture_of(dynamics, [(0.5, MEAN, STD), (0.5, far, STD)])
    distance = radar.measure(np.stack([MEAN, far]))[:, 0]
    missed = 0.5 * (1.0 - np.interp(distance, [0.0, 2e4], [0.9, 0.1]))
    branched, _ = updated(config, mixture, NOTHING)
    np.testing.assert_allclose(branched.mixture.sums.mass, missed / (0.5 + missed), rtol=1e-9)


def test_class_is_detected_as_probably_as_its_band_says():
    config = lone(
        {
            **TWO_MOTIONS,
            **UNREDUCED,
            **BANDS,
            "amplitude": "band",
            "radar.detection_probability": 0.0,
        }
    )
    (radar,), classes = config.model.radars, config.model.modes.classes
    mixture = mixture_of(Dynamics(config.model), [(0.8, MEAN, STD)])
    missed = 0.4 * (1.0 - of_classes(radar.threshold, classes))
    assert missed[0] > 2.0 * missed[1]
    branched, _ = updated(config, mixture, NOTHING)
    expected = missed / (0.2 + missed.sum())
    np.testing.assert_allclose(branched.mixture.class_mass(), expected, rtol=1e-9)


def test_detection_stronger_than_all_that_is_known_is_a_targets_beside_usual_ones():
    # Its density is too small for doubles both of the targets and, far more so, of clutter.
    config = lone(
        {
            **UNREDUCED,
            "amplitude": "memory",
            "radar.detection_probability": 0.0,
            "radar.clutter_rate": 5.0,
            "target.snr_band_db": [5.0, 25.0],
        }
    )
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    away = MEAN * [-1, 1, -1, 1, 1]
    mixture = mixture_of(dynamics, [(0.3, MEAN, STD), (0.3, away, STD)])
    report = Detections(radar.measure(np.stack([MEAN, away])), np.array([30.0, 1500.0]))
    branched, _ = updated(config, mixture, report)
    np.testing.assert_allclose(branched.mixture.sums.existence, 1.0, atol=1e-6)


def test_hypotheses_without_weight_change_nothing():
    config = lone({**UNREDUCED, "radar.clutter_rate": 5.0, "radar.detection_probability": 0.8})
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    one = mixture_of(dynamics, [(0.6, MEAN, STD)])
    nil = one.take(np.array([0, 0, 0]))
    nil = nil.changed(weight=nil.weight * np.array([0.0, 1.0, 0.0])[:, None, None])
    report = Detections(radar.measure(MEAN[None]), None)
    expected, _ = updated(config, one, report)
    found, _ = updated(config, nil, report)
    np.testing.assert_allclose(found.mixture.sums.mass, expected.mixture.sums.mass, rtol=1e-12)
    np.testing.assert_array_equal(found.parent, 1)


def test_detection_with_noise_and_time_of_its_own_is_that_of_such_a_radar_then():
    # The other radar has that noise; and a target that is as far back as it flies in that time.
    config = lone({**UNREDUCED, "radar.clutter_rate": 5.0, "radar.detection_probability": 0.9})
    (radar,), dynamics = config.model.radars, Dynamics(config.model)
    mixture = mixture_of(dynamics, [(0.9, MEAN, np.array([300.0, 1e-3, 250.0, 1e-3, 0.0]))])
    std, time = [40.0, 0.004], 0.5
    later = MEAN + time * np.array([MEAN[1], 0.0, MEAN[3], 0.0, 0.0])
    place = radar.measure(later[None]) + np.array([60.0, -0.005])
    own = Detections(place, None, time_s=[time], noise_std=[std])
    exact = replace(radar, range_std=std[0], azimuth_std=std[1])
    found, _ = updated(config, mixture, own)
    model = replace(config.model, radars=(exact,))
    expected, _ = updated(
        replace(config, model=model),
        mixture_of(dynamics, [(0.9, later, np.array([300.0, 1e-3, 250.0, 1e-3, 0.0]))]),
        Detections(place, None),
    )
    np.testing.assert_allclose(found.mixture.sums.mass, expected.mixture.sums.mass, rtol=1e-4)
    detected = int(np.argmax(found.mixture.sums.mass))
    shift = found.mixture.mean[detected, 0] - expected.mixture.mean[detected, 0]
    np.testing.assert_allclose(shift, MEAN - later, atol=0.5)
    np.testing.assert_allclose(
        found.mixture.covariance[detected, 0][[0, 2], [0, 2]],
        expected.mixture.covariance[detected, 0][[0, 2], [0, 2]],
        rtol=1e-3,
    )


def test_existence_is_kept_when_only_the_best_hypotheses_are():
    config = lone({**UNREDUCED, "radar.clutter_rate": 3.0, "radar.detection_probability": 0.8})
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    mixture = mixture_of(dynamics, [(0.9, MEAN, STD)])
    place = radar.measure(MEAN[None]) + np.array([[100.0, 0.01], [-150.0, 0.0], [0.0, 0.02]])
    every, _ = updated(config, mixture, Detections(place, None))
    few, _ = updated(config, mixture, Detections(place, None), hypotheses=2)
    assert len(every.mixture) == 4
    assert len(few.mixture) == 2
    np.testing.assert_allclose(few.mixture.sums.existence, every.mixture.sums.existence, rtol=1e-12)
    best = np.sort(every.mixture.sums.mass)[::-1][:2]
    np.testing.assert_allclose(
        np.sort(few.mixture.sums.mass)[::-1],
        best / best.sum() * few.mixture.sums.mass.sum(),
        rtol=1e-12,
    )


@dataclass(frozen=True)
class Notebook(ClutterMap):
    """A map that knows another rate of clutter and nothing else, and notes what it is to learn."""

    rate: float = 0.0
    looks: list = field(default_factory=list)
    learned: list = field(default_factory=list)

    def expect(self, view):
        return view.changed(clutter_rate=self.rate)

    def learn(self, look):
        self.looks.append(look)
        return super().learn(look)

    def after(self, measured, world, weight, revolutions):
        self.learned.append((measured, weight))
        return self

    def factors(self):
        return Factors.configured({"radar": (self,)}, None, False)


def notebook_of(radar, rate):
    return Notebook(PolarGrid.of_noise(*radar.noise_std), speed=20.0, rate=rate)


def resting(look):
    """Return the probability that the target of each detection is slower than 20 m/s."""
    return look.association.claims.share_of(look.targets.probability_slower(20.0))


def test_clutter_is_the_learned_one_and_learns_from_unclaimed_and_stationary_detections():
    config = lone({**UNREDUCED, "radar.clutter_rate": 1.0, "radar.detection_probability": 0.8})
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    slow, away = MEAN * [1, 0, 1, 0, 0], MEAN * [-1, 1, -1, 1, 1]
    # Their velocities are known.
    std = STD * [1.0, 1e-6, 1.0, 1e-6, 1.0]
    targets = [(0.6, MEAN, std), (0.7, slow, std), (0.5, away, std)]
    mixture = mixture_of(dynamics, targets)
    place = np.concatenate([radar.measure(MEAN[None]), radar.measure(away[None]), [[100.0, 0.0]]])
    report, notebook = Detections(place, None), notebook_of(radar, 500.0)
    known, _ = updated(config, mixture, report, factors=notebook.factors())
    more = replace(radar, clutter_rate=500.0)
    exact = replace(config, model=replace(config.model, radars=(more,)))
    expected, _ = updated(exact, mixture, report)
    np.testing.assert_allclose(known.mixture.sums.mass, expected.mixture.sums.mass, rtol=1e-12)
    (look,), ((measured, weight),) = notebook.looks, notebook.learned
    assert look.view.clutter_rate == 500.0
    np.testing.assert_array_equal(measured, place)
    claimed, still = look.association.claimed_probability, resting(look)
    np.testing.assert_allclose(weight, 1.0 - claimed * (1.0 - still), rtol=1e-12)
    assert claimed[2] == 0.0
    assert 0.5 < claimed[0] < 1.0
    # The target at rest has as much of the first detection as its weight is of both.
    np.testing.assert_allclose(still, [0.7 / 1.3, 0.0, 0.0], rtol=1e-9, atol=1e-20)
    notebook = notebook_of(radar, 500.0)
    faster = mixture_of(dynamics, [(1.0, MEAN * [1, 0, 1, 0, 0] + [0, 25, 0, 25, 0], std)])
    updated(config, faster, report, factors=notebook.factors())
    assert resting(notebook.looks[0])[0] < 1e-20


def test_clutter_learns_rest_at_even_odds_where_targets_are_born():
    given = {**UNREDUCED, **BIRTHS, "radar.detection_probability": 0.8}
    config = lone(given)
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    notebook = notebook_of(radar, 5.0)
    std = [1.0, 15.0, 1.0, 15.0, 1.0]
    mixture = mixture_of(dynamics, [(0.6, MEAN * [1, 0, 1, 0, 0], std)])
    report = Detections(radar.measure(MEAN[None]), None)
    updated(config, mixture, report, factors=notebook.factors())
    # Slower than 20 m/s, of newborn targets and of this one: the length of two normal velocities.
    newborn, own = (1.0 - np.exp(-0.5 * (20.0 / each) ** 2) for each in (35.0, 15.0))
    rest, motion = own / newborn, (1.0 - own) / (1.0 - newborn)
    (look,), ((_, weight),) = notebook.looks, notebook.learned
    moves = (1.0 - weight) / look.association.claimed_probability
    np.testing.assert_allclose(1.0 - moves, rest / (rest + motion), rtol=1e-2)


def test_every_mode_is_updated_with_the_detection_of_its_hypothesis(monkeypatch):
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))
    config = lone(
        {**TWO_MOTIONS, **UNREDUCED, "radar.clutter_rate": 3.0, "radar.detection_probability": 0.8}
    )
    dynamics, (radar,) = Dynamics(config.model), config.model.radars
    alike = mixture_of(dynamics, [(0.9, MEAN, STD)])
    mean, covariance = alike.mean.copy(), alike.covariance.copy()
    mean[0, 1, [0, 2]] += [150.0, -90.0]
    covariance[0, 1] *= 0.5
    mixture = alike.changed(mean=mean, covariance=covariance)
    place = radar.measure(MEAN[None]) + np.array([[100.0, 0.01], [-150.0, 0.0]])
    both, _ = updated(config, mixture, Detections(place, None))
    assert len(both.mixture) == 3
    for one in place:
        alone, _ = updated(config, mixture, Detections(one[None], None))
        for row in range(2):
            (same,) = [
                k
                for k in range(3)
                if np.allclose(both.mixture.mean[k], alone.mixture.mean[row], rtol=1e-9)
            ]
            np.testing.assert_allclose(
                both.mixture.covariance[same], alone.mixture.covariance[row], rtol=1e-9
            )


def detection_probability(radar, states):
    measured = radar.measure(states)
    in_view = radar.visibility.probability_in_view(measured)
    return in_view * radar.visibility.probability(measured[:, 0])


def existence_after(missed):
    """Return the existence probability of a target that was missed with a probability."""
    return 0.9 * missed / (0.9 * missed + 0.1)


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_target_that_stays_at_a_limit_keeps_the_existence_of_an_enumeration(field):
    config = lone({"radar.detection_probability": 0.9, **field})
    (radar,) = config.model.radars
    mean, std = MEAN.copy(), np.array([100.0, 1.0, 100.0, 1.0, 1e-4])
    mean[[0, 2]] = radar.to_world(np.array([[7e3, 0.8]]))[0]
    found = mixture_of(Dynamics(config.model), [(0.9, mean, std)])
    states = mean + std * np.random.default_rng(5).standard_normal((400_000, len(mean)))
    of_mean, *missed = 1.0 - detection_probability(radar, np.vstack([mean, states]))
    by_range = "radar.detection_probability" in field
    if not by_range:
        assert abs(existence_after(of_mean) - existence_after(np.mean(missed))) > 0.03
    for scans in range(1, 2 if by_range else 6):
        found = updated(config, found, NOTHING)[0].mixture
        exact = existence_after(np.mean(np.power(missed, scans)))
        assert found.sums.existence[0] == pytest.approx(exact, abs=3e-3 if scans == 1 else 0.05)


def scan_update(config, *reports, scan_index=4):
    """Return what the radars' reports make of nothing."""
    dynamics = Dynamics(config.model)
    nothing = mixture_of(dynamics, [(0.5, MEAN, STD)]).take(np.zeros(0, dtype=int))
    steps = GaussianSteps(dynamics, new_engine(config).forward.bounds)
    predicted = Branched(nothing, np.zeros(0, dtype=int))
    factors = new_engine(config).forward.factors
    return update_scan(
        predicted, steps.model.reports(Scan(1, reports)), steps, 6.0, scan_index, factors
    ).rows


@pytest.mark.parametrize("times", [None, [0.4, -1.5]], ids=["at the stamp", "with times"])
@pytest.mark.parametrize("own", [None, [[50.0, 0.03], [np.nan, 0.001]]], ids=["usual", "own"])
def test_newborn_is_at_its_detection_with_the_radars_noise_and_a_broad_velocity(times, own):
    config = lone({**TWO_MOTIONS, **BIRTHS})
    (radar,) = config.model.radars
    place = np.array([[7e3, 0.8], [4e3, -2.0]])
    report = Detections(place, None, time_s=times, noise_std=own)
    branched = scan_update(config, report)
    found = branched.mixture
    first = track_numbers.first_detected(4)
    np.testing.assert_array_equal(found.row_label, [first, first + 1])
    np.testing.assert_array_equal(branched.parent, [-1, -1])
    usual = np.broadcast_to(radar.noise_std, (2, 2))
    std = usual if own is None else np.where(np.isnan(own), usual, own)
    for row in range(2):
        position = radar.to_world(place[row : row + 1])[0]
        # Derivatives of the position by range and azimuth, numerically.
        steps = np.diag([1e-3, 1e-7])
        jacobian = (radar.to_world(place[row] + steps) - position) / np.diag(steps)[:, None]
        expected = np.zeros((5, 5))
        expected[np.ix_([0, 2], [0, 2])] = jacobian.T @ np.diag(std[row] ** 2) @ jacobian
        expected[[1, 3], [1, 3]] = 35.0**2
        expected[4, 4] = 2e-3**2
        back = np.eye(5)
        back[[0, 2], [1, 3]] = 0.0 if times is None else -times[row]
        expected = back @ expected @ back.T
        straight = np.outer([1, 1, 1, 1, 0], [1, 1, 1, 1, 0])
        np.testing.assert_allclose(found.mean[row, :, [0, 2]], np.tile(position[:, None], 2))
        np.testing.assert_array_equal(found.mean[row][:, [1, 3, 4]], 0.0)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        one, other = found.covariance[row, :, :5, :5] / scale
        np.testing.assert_allclose(one, expected * straight / scale, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(other, expected / scale, rtol=1e-4, atol=1e-9)


def test_newborns_of_a_radar_have_origins_after_those_of_the_radars_before():
    radars = {
        "sensors": ["radar", "other"],
        "radar.detection_probability": 0.5,
        "other.position": [1e4, 0.0],
        "other.detection_probability": 0.5,
        "other.clutter_rate": 1.0,
    }
    config = lone({**BIRTHS, **radars})
    one, two = config.model.radars
    points = np.zeros((5, 5))
    points[:, [0, 2]] = [[5e3, 0], [0, 5e3], [-5e3, 0], [0, -5e3], [5e3, 5e3]]
    reports = [Detections(r.measure(points[p]), None) for r, p in ((one, [0, 1, 2]), (two, [3, 4]))]
    first = track_numbers.first_detected(4)
    found = scan_update(config, *reports).mixture
    np.testing.assert_array_equal(np.sort(found.row_label), first + np.arange(5))


def test_newborn_has_the_cells_of_its_class_that_its_amplitude_tells():
    config = lone(
        {
            **BIRTHS,
            "amplitude": "memory",
            "radar.detection_probability": 0.0,
            "target.snr_band_db": [5.0, 30.0],
        }
    )
    dynamics = Dynamics(config.model)
    assert dynamics.cells.log_snr.shape[1] > 5
    amplitude = np.array([5.0, 20.0])
    report = Detections(np.array([[7e3, 0.8], [4e3, -2.0]]), amplitude)
    found = scan_update(config, report).mixture
    # Rayleigh, with the power of noise and target; the detection's mass is that of the class.
    power = np.exp(dynamics.cells.log_snr)
    density = amplitude[:, None] / power * np.exp(-(amplitude[:, None] ** 2) / (2.0 * power))
    share = density / density.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.snr[:, 0], share, rtol=1e-6)
    assert abs(share.argmax(axis=1)[0] - share.argmax(axis=1)[1]) > 2


def test_detections_that_were_left_out_are_noted_with_the_newborn(monkeypatch):
    for most in ("MAX_DETECTIONS", "MAX_UNEXPLAINED"):
        monkeypatch.setattr(limit, most, 2)
    config = lone({**BIRTHS})
    mixture = mixture_of(Dynamics(config.model), [(0.5, MEAN, STD)])
    report = Detections(np.array([[5e3, 0.1 * k] for k in range(8)]), None)
    _, newborn = updated(config, mixture, report)
    assert newborn.report.share == 0.25
