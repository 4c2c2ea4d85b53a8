"""The particle engine with a radar whose scans are sectors of a turn."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from sweep import (
    ROTATION_S,
    SECTORS,
    START_NS,
    TARGETS,
    configuration,
    position_at,
    scans,
    seconds_of,
)

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.types import Coverage, Detections, Scan

PERIOD = {"estimates_period_s": ROTATION_S, "lag": 3}
# Turns of the run with the defaults, and those after which tests go on from it.
LONGEST = 24
COPIED = (7, 8, 10, 12, 20, LONGEST)


def run(given=None, turns=12, **made):
    """Return the engine after the scans, and all filtered and smoothed estimates."""
    engine = new_engine(configuration({**PERIOD, **(given or {})}))
    filtered, smoothed = [], []
    for scan in scans(turns, **made):
        step = engine.step(scan)
        filtered += step.filtered
        smoothed += step.smoothed
    return engine, filtered, smoothed


@pytest.fixture(scope="module")
def default_run():
    """Return a run with the defaults, by the number of its turns; engines may be changed."""
    engine, filtered, smoothed = new_engine(configuration(PERIOD)), [], []
    at = {}
    for index, scan in enumerate(scans(LONGEST), start=1):
        step = engine.step(scan)
        filtered += step.filtered
        smoothed += step.smoothed
        if index % SECTORS == 0 and index // SECTORS in COPIED:
            at[index // SECTORS] = copy.deepcopy(engine), filtered[:], smoothed[:]

    def after(turns):
        held, *estimates = at[turns]
        return copy.deepcopy(held), *estimates

    return after


def errors(estimates):
    """Return the distance of each target to its nearest estimate, shape (T,)."""
    truth = position_at(seconds_of(estimates.stamp_ns))
    distance = np.hypot(*(truth[:, None] - estimates.position[None]).transpose(2, 0, 1))
    return distance.min(axis=1, initial=np.inf)


def test_every_target_is_reported_once_a_turn_at_a_common_stamp():
    _, filtered, smoothed = run({"particles_per_target": 400})
    stamps = [round(seconds_of(estimates.stamp_ns), 6) for estimates in filtered]
    assert stamps == [ROTATION_S * turn for turn in range(1, 12)]
    for estimates in filtered[4:]:
        assert len(estimates) == len(TARGETS)
        assert errors(estimates).max() < 400.0
    assert [estimates.stamp_ns for estimates in smoothed] == [
        estimates.stamp_ns for estimates in filtered[: len(smoothed)]
    ]
    for estimates in smoothed[3:]:
        assert errors(estimates).max() < 200.0


def test_smoothing_brings_targets_nearer_to_where_they_were(default_run):
    _, filtered, smoothed = default_run(20)
    late = [np.sqrt((errors(e) ** 2).mean()) for e in filtered[6:]]
    early = [np.sqrt((errors(e) ** 2).mean()) for e in smoothed[6:]]
    assert np.mean(early) < 0.8 * np.mean(late)


def test_targets_keep_their_numbers(default_run):
    _, filtered, _ = default_run(20)
    assert len({tuple(estimates.track_id) for estimates in filtered[5:]}) == 1


def test_scan_leaves_targets_alone_that_the_antenna_did_not_pass(default_run):
    engine, _, _ = default_run(8)
    forward = engine.forward
    before = {rows.entry.stamp_ns: rows.stored.state for rows in forward.current}
    (scan,) = [scans(9)[8 * SECTORS + 2]]
    engine.step(scan)
    kept = 0
    for rows in forward.current[:-1]:
        if rows.rows is None:
            np.testing.assert_array_equal(rows.stored.state, before[rows.entry.stamp_ns])
            kept += 1
    assert kept >= 2
    assert len(forward.stored) < sum(len(rows) for rows in forward.current)


def test_missed_target_is_missed_once_a_turn_and_not_by_every_sector(default_run):
    engine, filtered, _ = default_run(10)
    number = len(filtered[-1])
    empty = scans(11, missed=1.0)[10 * SECTORS :]
    reported = [estimates for scan in empty for estimates in engine.step(scan).filtered]
    assert number == len(TARGETS)
    # p_D is 0.95: one miss leaves an existence probability near 0.95, sixteen would leave none.
    assert len(reported[-1]) == len(TARGETS)
    mass = sum(rows.class_mass(np.zeros(2, dtype=int), 1)[0] for rows in engine.forward.current)
    assert 3.0 < mass < 4.1


def test_target_that_is_gone_is_dropped(default_run):
    engine, _, _ = default_run(8)
    empty = scans(14, missed=1.0)[8 * SECTORS :]
    reported = [estimates for scan in empty for estimates in engine.step(scan).filtered]
    assert len(reported[-1]) == 0


def test_estimates_of_every_sector_are_all_at_its_stamp():
    engine, _, _ = run({"estimates_period_s": 0.0, "lag": 20}, turns=8)
    for scan in scans(9)[8 * SECTORS :]:
        (found,) = engine.step(scan).filtered
        assert found.stamp_ns == scan.stamp_ns
        assert len(found) == len(TARGETS)
        assert errors(found).max() < 400.0


def test_window_is_as_long_as_the_lag_and_no_longer(default_run):
    engine, _, _ = default_run(20)
    assert len(engine._window) <= 6 * SECTORS
    linked = [entry for entry in engine._window if entry.link is not None]
    stamps = {entry.stamp_ns for entry in engine._window}
    assert all(any(s.stamp_ns in stamps for s in entry.sources) for entry in linked)


def test_lag_in_seconds_is_that_of_the_stamps():
    engine, filtered, smoothed = run({"lag": f"{3.0 * ROTATION_S:g} s"})
    assert len(filtered) - len(smoothed) == 3
    assert len(engine.flush()) == 3


def test_flush_gives_the_stamps_that_were_held_back(default_run):
    engine, filtered, smoothed = default_run(12)
    rest = engine.flush()
    assert [e.stamp_ns for e in [*smoothed, *rest]] == [e.stamp_ns for e in filtered]


def test_restored_engine_goes_on_as_if_it_had_never_stopped(default_run):
    engine, _, _ = default_run(7)
    fresh = new_engine(configuration(PERIOD))
    fresh.restore(engine.snapshot())
    compared = 0
    for scan in scans(10)[7 * SECTORS :]:
        ours, theirs = engine.step(scan), fresh.step(scan)
        for one, other in zip(
            [*ours.filtered, *ours.smoothed], [*theirs.filtered, *theirs.smoothed], strict=True
        ):
            np.testing.assert_array_equal(one.state, other.state)
            np.testing.assert_array_equal(one.track_id, other.track_id)
            compared += 1
    assert compared >= 4


@pytest.mark.parametrize("sectors", [4, 32])
def test_number_of_sectors_makes_no_difference_to_the_errors(default_run, sectors):
    def mean_square(filtered):
        return np.mean([(errors(e) ** 2).mean() for e in filtered[6:]])

    _, filtered, _ = run(turns=LONGEST, sectors=sectors)
    found = mean_square(filtered) / mean_square(default_run(LONGEST)[1])
    assert 0.75 < np.sqrt(found) < 1.33


def seen_at(seconds, targets, coverage=None):
    """Return the scan of some targets' plots, without errors."""
    x, y = position_at(seconds)[targets].T
    found = Detections(np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1), None, None)
    stamp_ns = START_NS + round(seconds * 1e9)
    return Scan(stamp_ns, (replace(found, coverage=coverage),))


def test_newborns_of_one_set_are_drawn_again_one_after_the_other_and_stay_so():
    engine = new_engine(configuration(PERIOD))
    engine.step(seen_at(0.0, [0, 1]))
    ((rows, born),) = [(rows, rows.entry.stored) for rows in engine.forward.current]
    drawn = []
    for seconds, target in ((4.0, 0), (4.5, 1)):
        (x, y) = position_at(seconds)[target]
        engine.step(seen_at(seconds, [target], Coverage(np.arctan2(y, x) - 0.2, 0.4)))
        (entry,) = [each for each in engine._window if each.stamp_ns == rows.entry.stamp_ns]
        changed = (entry.stored.state != born.state).any(axis=1)
        drawn.append(
            (set(born.origin[changed]), entry.stored.state[born.origin == min(born.origin)])
        )
    (first, of_first), (both, later_of_first) = drawn
    # The first one's velocities are those that its next detection was explained with.
    assert len(first) == 1
    assert len(both) == 2
    np.testing.assert_array_equal(later_of_first, of_first)
