"""Particles of lost targets: their weights and moments against those of Gaussians."""

import numpy as np
import pytest
from lone import MEAN, lone
from scipy import sparse
from scipy.stats import multivariate_normal

from phd_jdtc_ros.core.attributes.uniqueness import OutOfGate
from phd_jdtc_ros.core.models.manoeuvre import PROBABILITY, manoeuvre
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import report_in_plane
from phd_jdtc_ros.core.smc.reacquisition import with_reacquired
from phd_jdtc_ros.core.types import Detections

SINCE_S, TIME_S, EXISTENCE = 4.0, -0.5, 0.8


def strayed(seed=3):
    """Return a set with a target's strays, the target's state, the place and the model."""
    config = lone({"engine": "particles", "particles_per_birth": 4096})
    (radar,) = config.model.radars
    count = 10
    before = ParticleSet(
        state=np.tile(MEAN, (count, 1)),
        mode=np.zeros(count, dtype=np.int64),
        row_label=np.full(count, 5),
        parent=np.arange(count),
        multiplicity=np.ones(count, dtype=np.int64),
        poisson=np.full(count, EXISTENCE / count),
        components=sparse.csr_array((count, 0)),
        label=np.zeros(0, dtype=np.int64),
        log_snr=np.zeros(count),
    )
    place = radar.measure(MEAN[None] + [150.0, 0.0, -120.0, 0.0, 0.0])
    report = Report(radar, Detections(place, None, time_s=np.array([TIME_S])))
    lost = OutOfGate(np.array([0]), np.array([0]), np.array([SINCE_S]))
    rng = np.random.default_rng(seed)
    after = with_reacquired(before, lost, report, config.model, rng)
    return before, after, report_in_plane(report), config.model


def test_strays_have_the_evidence_of_the_manoeuvre_that_leads_to_the_detection():
    before, after, seen, model = strayed()
    new = np.arange(len(before), len(after))
    assert set(after.row_label[new]) == {5}
    at = after.state[new][:, [0, 2]] + TIME_S * after.state[new][:, [1, 3]]
    likelihood = multivariate_normal(seen.position[0], seen.covariance[0]).pdf(at)
    found = float(after.weight[new] @ likelihood)
    expected = MEAN[[0, 2]] + TIME_S * MEAN[[1, 3]]
    spread = seen.covariance[0] + manoeuvre(np.array([SINCE_S]), model).position[0] * np.eye(2)
    evidence = multivariate_normal(expected, spread).pdf(seen.position[0])
    # The deviation of the mean of 4096 draws is some per cent.
    assert found == pytest.approx(PROBABILITY * EXISTENCE * evidence, rel=0.1)


def test_strays_have_the_velocities_of_the_manoeuvre():
    before, after, _, model = strayed()
    new = np.arange(len(before), len(after))
    done = manoeuvre(np.array([SINCE_S]), model)
    at = after.state[new][:, [0, 2]] + TIME_S * after.state[new][:, [1, 3]]
    moved = at - (MEAN[[0, 2]] + TIME_S * MEAN[[1, 3]])
    change = after.state[new][:, [1, 3]] - MEAN[[1, 3]]
    rest = change - (done.position_velocity / done.position) * moved
    variance = done.velocity - done.position_velocity**2 / done.position
    assert abs(rest.mean()) < 5.0 * np.sqrt(variance[0] / rest.size)
    assert rest.var() == pytest.approx(variance[0], rel=0.1)


def test_target_keeps_the_rest_of_its_weight():
    before, after, _, _ = strayed()
    kept = after.weight[: len(before)].sum()
    assert kept == pytest.approx((1.0 - PROBABILITY) * EXISTENCE)
