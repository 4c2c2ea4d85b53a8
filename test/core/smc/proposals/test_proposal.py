from dataclasses import replace

import numpy as np
import pytest
from scenes import intensity
from scipy.stats import multivariate_normal, norm
from sweep import configuration

from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.smc.proposals import proposal
from phd_jdtc_ros.core.smc.proposals.detected_newborns import redraw_velocities
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import InPlane
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn
from phd_jdtc_ros.core.tracks.labels import first_detected, first_predicted
from phd_jdtc_ros.core.window.entries import Entry, UnsweptRows

DT = 4.0
CV = ConstantVelocity(100.0)
STATE = np.array([0.0, 200.0, 1000.0, 0.0, 0.0])
SPREAD = float(np.sqrt(CV.noise_covariance(DT)[0, 0]))
STD = 150.0
BIRTH_MODEL = replace(
    configuration().model, detection_births=DetectionBirthModel(np.array([0.5]), STD, 0.01, 128)
)
SECOND = 1_000_000_000
BORN = first_detected(3)


def seen(position, std=10.0, time_s=0.0):
    position = np.atleast_2d(position)
    count = len(position)
    return InPlane(position, np.tile(std**2 * np.eye(2), (count, 1, 1)), np.full(count, time_s))


def drawn(model, places, count=40_000, seed=0):
    rng = np.random.default_rng(seed)
    return proposal.sample(model, np.tile(STATE, (count, 1)), DT, places, rng)


@pytest.mark.parametrize("model", [CV, CoordinatedTurn(100.0, 1e-4)])
@pytest.mark.parametrize(
    "position",
    [[[850.0, 1030.0]], [[700.0, 1100.0], [900.0, 900.0]]],
    ids=["one detection", "two detections"],
)
def test_sample_leaves_the_predicted_density_as_it_was(model, position):
    state, factor = drawn(model, seen(position))
    support = list(model.support)
    mean = model.mean(STATE[None], DT)[0, support]
    noise = model.noise_covariance(DT)
    assert factor.mean() == pytest.approx(1.0, abs=0.02)
    scale = np.sqrt(np.diag(noise))
    offset = (state[:, support] - mean) / scale
    np.testing.assert_allclose((factor[:, None] * offset).mean(axis=0), 0.0, atol=0.05)
    correlation = noise / np.outer(scale, scale)
    np.testing.assert_allclose(
        (factor[:, None] * offset).T @ offset / len(offset), correlation, atol=0.05
    )


def test_sample_explains_detections_and_estimates_their_evidence():
    place = np.array([800.0 + 2.0 * SPREAD, 1000.0])
    effective = {}
    for name, places in (("blind", seen(np.zeros((0, 2)))), ("guided", seen(place, 2.0))):
        state, factor = drawn(CV, places, 1000)
        weight = factor * np.exp(-0.5 * ((state[:, [0, 2]] - place) ** 2).sum(axis=1) / 2.0**2)
        effective[name] = weight.sum() ** 2 / (weight**2).sum()
    assert effective["blind"] < 5.0
    assert effective["guided"] > 200.0
    place = np.array([800.0 + SPREAD, 1000.0 - SPREAD])
    state, factor = drawn(CV, seen(place))
    likelihood = norm.pdf(state[:, [0, 2]], place, 10.0).prod(axis=1)
    covariance = (SPREAD**2 + 10.0**2) * np.eye(2)
    expected = multivariate_normal([800.0, 1000.0], covariance).pdf(place)
    assert (factor * likelihood).mean() == pytest.approx(expected, rel=0.02)


def test_sample_follows_the_detection_to_its_own_time():
    # Seen half a second after the stamp, the target was 100 m farther back at the stamp.
    state, factor = drawn(CV, seen([900.0, 1000.0], 2.0, time_s=0.5))
    pulled = np.abs(state[:, 0] + 0.5 * state[:, 1] - 900.0) < 6.0
    assert pulled.mean() > 0.6
    assert factor.mean() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "places",
    [seen(np.zeros((0, 2))), seen([800.0, 1000.0], 10.0 * SPREAD)],
    ids=["no detection", "a detection that is not precise"],
)
def test_sample_without_precise_detections_is_that_of_the_motion(places):
    state, factor = drawn(CV, places, 50)
    rng = np.random.default_rng(0)
    expected = proposal.motion.sample(CV, np.tile(STATE, (50, 1)), DT, rng)
    np.testing.assert_array_equal(state, expected)
    assert (factor == 1.0).all()


def test_weights_have_a_bound_and_far_detections_no_effect():
    state, factor = drawn(CV, seen([9e3, 9e3]), 50)
    assert (factor == 1.0).all()
    assert np.abs(state[:, 0] - 800.0).max() < 5.0 * SPREAD
    _, factor = drawn(CV, seen([[850.0, 1030.0], [800.0, 1000.0]], 1.0))
    assert factor.max() <= 1.0 / proposal.BLIND_SHARE


def newborn(row_label=BORN, parent=-1, count=4000):
    rng = np.random.default_rng(1)
    state = np.zeros((count, 5))
    state[:, [0, 2]] = [20e3, 5e3] + 40.0 * rng.standard_normal((count, 2))
    state[:, [1, 3]] = STD * rng.standard_normal((count, 2))
    particles = intensity(
        state,
        np.full(count, 0.2 / count),
        row_label=np.full(count, row_label),
        components=np.full((count, 1), 0.0),
    )
    return UnsweptRows(Entry(0, replace(particles, parent=np.full(count, parent))))


def detected(positions, std=40.0):
    positions = np.atleast_2d(np.asarray(positions, dtype=float))
    count = len(positions)
    return InPlane(positions, np.tile(std**2 * np.eye(2), (count, 1, 1)), np.zeros(count))


def redrawn(rows, places, seed=0):
    rng = np.random.default_rng(seed)
    (found,) = redraw_velocities([rows], round(DT * SECOND), places, BIRTH_MODEL, rng)
    return found.entry.stored


def test_informed_velocities_have_the_prior_as_before():
    rows = newborn()
    found = redrawn(rows, detected([20.5e3, 5.3e3]))
    share = found.weight / found.weight.sum()
    assert found.weight.sum() == pytest.approx(0.2)
    velocity = found.state[:, [1, 3]]
    np.testing.assert_allclose(share @ velocity, 0.0, atol=12.0)
    np.testing.assert_allclose(share @ velocity**2, STD**2, rtol=0.12)
    np.testing.assert_array_equal(found.state[:, [0, 2]], rows.entry.stored.state[:, [0, 2]])


def test_informed_velocities_lead_to_the_next_detections():
    places = detected([[20.5e3, 5.3e3], [19.2e3, 4.8e3]])
    before, after = newborn(), None
    after = redrawn(before, places)
    for place in places.position:
        near = [
            (np.hypot(*(s[:, [0, 2]] + DT * s[:, [1, 3]] - place).T) < 120.0).mean()
            for s in (before.entry.stored.state, after.state)
        ]
        assert near[0] < 0.03
        assert near[1] > 0.2


@pytest.mark.parametrize(
    ("rows", "places"),
    [
        (newborn(row_label=first_predicted(3)), detected([20.5e3, 5.3e3])),
        (newborn(parent=7), detected([20.5e3, 5.3e3])),
        (newborn(), detected([60e3, 5e3])),
        (newborn(), detected([20.5e3, 5.3e3], std=400.0)),
        (newborn(), detected(np.zeros((0, 2)))),
    ],
    ids=["born at a place", "no longer newborn", "out of reach", "not precise", "nothing seen"],
)
def test_informed_leaves_other_targets_alone(rows, places):
    found = redrawn(rows, places)
    np.testing.assert_array_equal(found.state, rows.entry.stored.state)
    np.testing.assert_array_equal(found.weight, rows.entry.stored.weight)


def test_informed_takes_swept_rows_without_measured_velocities():
    rows = newborn()
    half = UnsweptRows(rows.entry, np.arange(0, 4000, 2))
    found = redrawn(half, detected([20.5e3, 5.3e3]))
    np.testing.assert_array_equal(found.state[1::2], rows.entry.stored.state[1::2])
    assert (found.state[::2] != rows.entry.stored.state[::2]).any()
    radars = tuple(replace(radar, range_rate=RangeRateModel(2.0)) for radar in BIRTH_MODEL.radars)
    rows, rng = newborn(), np.random.default_rng(0)
    model = replace(BIRTH_MODEL, radars=radars)
    (found,) = redraw_velocities([rows], round(DT * SECOND), detected([20.5e3, 5.3e3]), model, rng)
    assert found is rows
