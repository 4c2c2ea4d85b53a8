"""The Gaussian engine with a radar whose scans are sectors of a turn."""

import numpy as np
import pytest
from sweep import ROTATION_S, SECTORS, TARGETS, configuration, position_at, scans, seconds_of

from phd_jdtc_ros.configuration.engines import new_engine

PERIOD = {"engine": "gaussian", "estimates_period_s": ROTATION_S, "lag": 3}


def run(given=None, turns=14, **made):
    """Return the engine after the scans, and all filtered and smoothed estimates."""
    engine = new_engine(configuration({**PERIOD, **(given or {})}))
    filtered, smoothed = [], []
    for scan in scans(turns, **made):
        step = engine.step(scan)
        filtered += step.filtered
        smoothed += step.smoothed
    return engine, filtered, smoothed


def matched(estimates, others):
    """Return the distances of estimates to their nearest ones of another run."""
    apart = estimates.position[:, None] - others.position[None]
    return np.hypot(*apart.transpose(2, 0, 1)).min(axis=1, initial=np.inf)


def errors(estimates):
    truth = position_at(seconds_of(estimates.stamp_ns))
    apart = truth[:, None] - estimates.position[None]
    return np.hypot(*apart.transpose(2, 0, 1)).min(axis=1, initial=np.inf)


def test_every_target_is_reported_once_a_turn_at_a_common_stamp():
    _, filtered, smoothed = run()
    stamps = [round(seconds_of(estimates.stamp_ns), 6) for estimates in filtered]
    assert stamps == [ROTATION_S * turn for turn in range(1, 14)]
    for estimates in filtered[4:]:
        assert len(estimates) == len(TARGETS)
        assert errors(estimates).max() < 400.0
    for estimates in smoothed[3:]:
        assert len(estimates) == len(TARGETS)
        assert errors(estimates).max() < 200.0


def test_sectors_and_whole_turns_with_plot_times_give_about_the_same_estimates():
    _, parts, parts_smoothed = run(sectors=SECTORS)
    _, turns, turns_smoothed = run(sectors=1)
    assert len(parts) == len(turns) == 13
    for ours, theirs in [*zip(parts, turns, strict=True)][6:]:
        assert len(ours) == len(theirs) == len(TARGETS)
        # A whole turn is stamped in its middle and the plots move straight on within it.
        assert (matched(ours, theirs) < 0.5 * np.hypot(*_position_std(ours))).all()
    for ours, theirs in [*zip(parts_smoothed, turns_smoothed, strict=True)][4:]:
        assert len(ours) == len(theirs) == len(TARGETS)
        assert (matched(ours, theirs) < 0.5 * np.hypot(*_position_std(ours))).all()
        np.testing.assert_allclose(_position_std(ours), _position_std(theirs), rtol=0.2)


def _position_std(estimates):
    variance = np.diagonal(estimates.covariance, axis1=1, axis2=2)
    return np.sqrt(variance[:, [0, 2]].T)


def test_scan_leaves_targets_alone_that_the_antenna_did_not_pass():
    engine, _, _ = run(turns=8)
    forward = engine.forward
    before = {rows.entry.stamp_ns: rows.entry.stored for rows in forward.current}
    alive = {origin for rows in forward.current for origin in rows.origin.tolist()}
    engine.step(scans(9)[8 * SECTORS + 2])
    kept = 0
    for rows in forward.current[:-1]:
        assert rows.entry.stored is before[rows.entry.stamp_ns]
        kept += len(rows)
    assert kept >= 2
    now = {origin for rows in forward.current for origin in rows.origin.tolist()}
    touched = {*forward.current[-1].entry.stored.origin.tolist()}
    # Every target is in one place, and none is in two.
    assert sum(len({*rows.origin.tolist()}) for rows in forward.current) == len(now)
    assert alive - touched <= now


def test_missed_target_is_missed_once_a_turn_and_not_by_every_sector():
    engine, filtered, _ = run(turns=10)
    number = len(filtered[-1])
    empty = scans(11, missed=1.0)[10 * SECTORS :]
    reported = [estimates for scan in empty for estimates in engine.step(scan).filtered]
    assert number == len(TARGETS)
    assert len(reported[-1]) == len(TARGETS)
    mass = sum(rows.class_mass(np.zeros(2, dtype=int), 1)[0] for rows in engine.forward.current)
    assert 3.0 < mass < 4.1


def test_target_that_is_gone_is_dropped():
    engine, _, _ = run(turns=8)
    empty = scans(14, missed=1.0)[8 * SECTORS :]
    reported = [estimates for scan in empty for estimates in engine.step(scan).filtered]
    assert len(reported[-1]) == 0


def test_smoothing_over_sectors_brings_targets_nearer_to_where_they_were():
    _, filtered, smoothed = run(turns=20)
    late = np.sqrt(np.mean([errors(estimates) ** 2 for estimates in filtered[6:17]]))
    early = np.sqrt(np.mean([errors(estimates) ** 2 for estimates in smoothed[6:17]]))
    assert early < 0.8 * late


def test_smoothed_targets_that_later_sectors_did_not_touch_are_filtered_ones():
    engine, _, _ = run({"estimates_period_s": 0.0, "lag": 20}, turns=6)
    window = engine._window
    smoothed = list(engine._backward(window))[::-1]
    later = {
        (source.stamp_ns, row)
        for entry in window
        for source in entry.sources
        for row in (range(source.size) if source.rows is None else source.rows.tolist())
    }
    untouched = touched = 0
    for entry, told in zip(window, smoothed, strict=True):
        for row in range(len(entry.stored)):
            same = np.array_equal(told.mean[row], entry.stored.mean[row])
            if (entry.stamp_ns, row) in later:
                touched += not same
            else:
                assert same
                np.testing.assert_array_equal(told.weight[row], entry.stored.weight[row])
                untouched += 1
    assert untouched > 3
    assert touched > 3


@pytest.mark.parametrize("given", [{}, {"lag": f"{3.0 * ROTATION_S:g} s"}])
def test_restored_engine_goes_on_as_if_it_had_never_stopped(given):
    engine, _, _ = run(given, turns=7)
    fresh = new_engine(configuration({**PERIOD, **given}))
    fresh.restore(engine.snapshot())
    compared = 0
    for scan in scans(10)[7 * SECTORS :]:
        ours, theirs = engine.step(scan), fresh.step(scan)
        for one, other in zip(
            [*ours.filtered, *ours.smoothed], [*theirs.filtered, *theirs.smoothed], strict=True
        ):
            np.testing.assert_array_equal(one.state, other.state)
            np.testing.assert_array_equal(one.covariance, other.covariance)
            np.testing.assert_array_equal(one.track_id, other.track_id)
            compared += 1
    assert compared >= 4
