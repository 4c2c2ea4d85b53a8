from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scenes import intensity
from sweep import configuration

from phd_jdtc_ros.core.smc.proposals.birth_newborns import redraw_velocities
from phd_jdtc_ros.core.targets.birth import BirthTerm
from phd_jdtc_ros.core.tracks.labels import first_detected, first_predicted
from phd_jdtc_ros.core.types import Detections, Scan

SCAN_INDEX = 7
SPEED, SPREAD = 30.0, 12.0
MEAN = np.array([1000.0, SPEED, -500.0, 0.0, 0.0])
STD = np.array([200.0, SPREAD, 200.0, SPREAD, 0.01])
BASE = configuration().model
MODES = len(BASE.modes)
TERMS = (
    BirthTerm("elsewhere", np.zeros(5), np.full(5, 1e-6), np.full(MODES, 0.1)),
    BirthTerm("here", MEAN, STD, np.full(MODES, 0.1)),
)
MODEL = replace(BASE, births=TERMS)
HERE = first_predicted(SCAN_INDEX) + 1
PLACES = np.array([[1010.0, -490.0], [900.0, -300.0], [1200.0, -700.0]])
COPIES = np.array([4000, 1, 2000])


def resampled(row_label=HERE, parent=-1, mode=0):
    """Return three particles at different places with as many copies as `COPIES`."""
    state = np.zeros((3, 5))
    state[:, [0, 2]] = PLACES
    state[:, [1, 3]] = 5.0
    mass = COPIES / COPIES.sum() * 0.9
    particles = intensity(
        state,
        np.zeros(3),
        mode=np.full(3, mode),
        row_label=np.full(3, row_label),
        components=mass[:, None],
    )
    return replace(particles, parent=np.full(3, parent), multiplicity=COPIES)


def scan(**columns):
    found = Detections(np.array([[1000.0, 0.1]]), None, **columns)
    return Scan(0, (found, None))


def spread_of(particles, seen=None, model=MODEL):
    return redraw_velocities(particles, seen or scan(), model, SCAN_INDEX, np.random.default_rng(3))


def test_every_copy_has_a_row_at_its_place_and_no_mass_is_gained():
    before = resampled()
    after = spread_of(before)
    assert len(after) == COPIES.sum()
    assert (after.multiplicity == 1).all()
    assert after.weight.sum() == pytest.approx(before.weight.sum())
    for place, copies, mass in zip(PLACES, COPIES, before.weight, strict=True):
        at = (after.state[:, [0, 2]] == place).all(axis=1)
        assert at.sum() == copies
        assert after.weight[at].sum() == pytest.approx(mass)
    assert_array_equal(np.unique(after.parent), [-1])


def test_velocities_are_those_of_the_birth_term_at_every_place():
    after = spread_of(resampled())
    for place, copies in zip(PLACES, COPIES, strict=True):
        if copies == 1:
            continue
        velocity = after.state[(after.state[:, [0, 2]] == place).all(axis=1)][:, [1, 3]]
        bound = 4.0 * SPREAD / np.sqrt(copies)
        assert velocity.mean(axis=0) == pytest.approx([SPEED, 0.0], abs=bound)
        assert velocity.std(axis=0) == pytest.approx([SPREAD, SPREAD], rel=0.08)
        assert len(np.unique(velocity[:, 0])) == copies


def test_turn_rates_are_drawn_where_the_motion_has_one():
    turning = [i for i, motion in enumerate(BASE.modes.motions) if 4 in motion.support]
    straight = [i for i, motion in enumerate(BASE.modes.motions) if 4 not in motion.support]
    assert spread_of(resampled(mode=turning[0])).state[:, 4].std() == pytest.approx(0.01, rel=0.08)
    assert (spread_of(resampled(mode=straight[0])).state[:, 4] == 0.0).all()


@pytest.mark.parametrize(
    "particles",
    [resampled(parent=5), resampled(row_label=first_detected(SCAN_INDEX))],
    ids=["survivors", "born at a detection"],
)
def test_the_velocities_of_others_stay(particles):
    assert spread_of(particles) is particles


@pytest.mark.parametrize(
    "column",
    [{"range_rate": np.array([3.0])}, {"time_s": np.array([0.2])}],
    ids=["range rate", "time"],
)
def test_a_scan_with_range_rates_leaves_velocities(column):
    particles = resampled()
    assert spread_of(particles, scan(**column)) is particles


def test_times_at_the_stamp_have_no_effect_on_velocities():
    assert len(spread_of(resampled(), scan(time_s=np.zeros(1)))) == COPIES.sum()
