from dataclasses import replace

import numpy as np
import pytest
from scenes import intensity
from sweep import configuration

from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel
from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.smc.proposals.detected_newborns import redraw_velocities
from phd_jdtc_ros.core.smc.proposals.detections_in_plane import InPlane
from phd_jdtc_ros.core.tracks.labels import first_detected, first_predicted
from phd_jdtc_ros.core.window.entries import Entry, UnsweptRows

STD = 150.0
MODEL = replace(
    configuration().model, detection_births=DetectionBirthModel(np.array([0.5]), STD, 0.01, 128)
)
SECOND = 1_000_000_000
DT = 4.0


BORN = first_detected(3)


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


def seen(positions, std=40.0):
    positions = np.atleast_2d(np.asarray(positions, dtype=float))
    count = len(positions)
    return InPlane(positions, np.tile(std**2 * np.eye(2), (count, 1, 1)), np.zeros(count))


def redrawn(rows, places, seed=0):
    rng = np.random.default_rng(seed)
    (found,) = redraw_velocities([rows], round(DT * SECOND), places, MODEL, rng)
    return found.entry.stored


def test_informed_velocities_have_the_prior_as_before():
    rows = newborn()
    found = redrawn(rows, seen([20.5e3, 5.3e3]))
    share = found.weight / found.weight.sum()
    assert found.weight.sum() == pytest.approx(0.2)
    velocity = found.state[:, [1, 3]]
    np.testing.assert_allclose(share @ velocity, 0.0, atol=12.0)
    np.testing.assert_allclose(share @ velocity**2, STD**2, rtol=0.12)
    np.testing.assert_array_equal(found.state[:, [0, 2]], rows.entry.stored.state[:, [0, 2]])


def test_informed_velocities_lead_to_the_next_detections():
    places = seen([[20.5e3, 5.3e3], [19.2e3, 4.8e3]])
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
        (newborn(row_label=first_predicted(3)), seen([20.5e3, 5.3e3])),
        (newborn(parent=7), seen([20.5e3, 5.3e3])),
        (newborn(), seen([60e3, 5e3])),
        (newborn(), seen([20.5e3, 5.3e3], std=400.0)),
        (newborn(), seen(np.zeros((0, 2)))),
    ],
    ids=["born at a place", "no longer newborn", "out of reach", "not precise", "nothing seen"],
)
def test_informed_leaves_other_targets_alone(rows, places):
    found = redrawn(rows, places)
    np.testing.assert_array_equal(found.state, rows.entry.stored.state)
    np.testing.assert_array_equal(found.weight, rows.entry.stored.weight)


def test_informed_takes_touched_rows_without_measured_velocities():
    rows = newborn()
    half = UnsweptRows(rows.entry, np.arange(0, 4000, 2))
    found = redrawn(half, seen([20.5e3, 5.3e3]))
    np.testing.assert_array_equal(found.state[1::2], rows.entry.stored.state[1::2])
    assert (found.state[::2] != rows.entry.stored.state[::2]).any()
    radars = tuple(replace(radar, range_rate=RangeRateModel(2.0)) for radar in MODEL.radars)
    rows, rng = newborn(), np.random.default_rng(0)
    model = replace(MODEL, radars=radars)
    (found,) = redraw_velocities([rows], round(DT * SECOND), seen([20.5e3, 5.3e3]), model, rng)
    assert found is rows
