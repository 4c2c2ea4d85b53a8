"""The Gaussian engine on the reference scene, with two radars and births."""

import numpy as np
import pytest
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.simulation.simulate import simulate

SCANS = [scan for _, scan in simulate(short_scenario(12), 5)]
BIRTHS = {"births": [], "detection_births.rates": [0.1, 0.1]}


def gaussian(given=None):
    return new_engine(small({"engine": "gaussian", "lag": 3, **(given or {})}))


@pytest.mark.parametrize("given", [{}, {"bounds.hypotheses": 1}, BIRTHS, {"spawn.rate": 0.1}])
def test_children_are_of_the_origin_of_their_parents_though_rows_go_between_radars(given):
    engine = gaussian(given)
    linked = dropped = 0
    for scan in SCANS:
        before = engine.forward.unswept
        sources = (
            np.concatenate([rows.row_label for rows in before]) if before else np.zeros(0, int)
        )
        engine.step(scan)
        entry = engine.forward.unswept[-1].entry
        if entry.link is None:
            continue
        ancestry = entry.link.ancestry
        survivors = ancestry.parent >= 0
        child, parent = ancestry.child[survivors], ancestry.parent[survivors]
        # Parents are the rows before the first radar, whatever was dropped since.
        np.testing.assert_array_equal(sources[parent], entry.stored.row_label[child])
        newborn = np.setdiff1d(np.arange(len(entry.stored)), child)
        assert not np.isin(entry.stored.row_label[newborn], sources).any()
        assert (np.diff(ancestry.child) >= 0).all()
        linked += len(child)
        dropped += len(np.setdiff1d(np.arange(len(sources)), parent))
    assert linked > 30
    assert dropped > 0


@pytest.mark.parametrize("bound", [1, 3, 8])
def test_bounds_hold_after_every_scan(bound):
    engine = gaussian({"bounds.hypotheses": bound, "bounds.most": 100, **BIRTHS})
    modes = len(engine.forward.dynamics.motions)
    for scan in SCANS:
        figures = engine.step(scan).figures
        stored = engine.forward.unswept[-1].entry.stored
        assert np.bincount(stored.target).max() <= bound * modes
        assert len(stored) == figures["hypotheses"] <= 100
        assert stored.existence.max() <= 1.0 + 1e-9
        assert stored.existence.min() >= engine.forward.bounds.least_existence


def test_smoothed_existence_is_a_probability_and_hindsight_agrees_with_the_last_scan():
    engine = gaussian({"lag": 5})
    for scan in SCANS[:8]:
        engine.step(scan)
    smoothed = backward_pass(engine._window)
    for found, filtered in zip(
        smoothed[0].gaussians, engine._window[-1].stored.gaussians, strict=True
    ):
        np.testing.assert_array_equal(found, filtered)
    for mixture in smoothed:
        assert (mixture.weight >= 0.0).all()
        assert mixture.existence.max() <= 1.0 + 1e-9
    # Who exists at the last scan existed before: nobody lives twice.
    last = smoothed[0]
    for earlier in smoothed[1:4]:
        shared, now, then = np.intersect1d(last.label, earlier.label, return_indices=True)
        assert len(shared) > 0
        assert (earlier.existence[then] >= last.existence[now] - 1e-6).all()


def test_class_mass_is_that_of_the_stored_mixture():
    engine = gaussian()
    for scan in SCANS[:5]:
        step = engine.step(scan)
    total = engine.forward.unswept[-1].entry.stored.existence.sum()
    assert step.class_mass.sum() == pytest.approx(total, rel=1e-9)


def test_steps_are_the_same_in_every_run():
    one, other = gaussian(), gaussian({"seed": 7})
    for scan in SCANS:
        ours, theirs = one.step(scan), other.step(scan)
        np.testing.assert_array_equal(ours.filtered[0].state, theirs.filtered[0].state)
