"""Radars whose scans are sectors: a target is passed, reported and missed once a revolution."""

import numpy as np
import pytest
from runs import restored_after, stepped
from sweep import (
    ROTATION_S,
    SECTORS,
    TARGETS,
    configuration,
    position_at,
    scans,
    seconds_of,
)

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass

PERIOD = {"estimates_period_s": ROTATION_S, "lag": 3}
# Revolutions of the run with the defaults, and those after which tests go on from it.
LONGEST = 24
COPIED = (8, 10, 12, 20, LONGEST)


def engine_of(**given):
    return new_engine(configuration({**PERIOD, **given}))


def run(revolutions=12, sectors=SECTORS, **given):
    """Return the engine after the scans, and all filtered and smoothed estimates."""
    engine = engine_of(**given)
    return engine, *stepped(engine, scans(revolutions, sectors=sectors))


@pytest.fixture(scope="module")
def default_run():
    """Return a run with the defaults, by the number of its revolutions; engines are restored."""
    engine, filtered, smoothed, at = engine_of(), [], [], {}
    every = scans(LONGEST)
    for revolution in range(1, LONGEST + 1):
        estimates = stepped(engine, every[(revolution - 1) * SECTORS : revolution * SECTORS])
        filtered, smoothed = filtered + estimates[0], smoothed + estimates[1]
        if revolution in COPIED:
            at[revolution] = engine.snapshot(), filtered, smoothed

    def after(revolutions):
        snapshot, *estimates = at[revolutions]
        restored = engine_of()
        restored.restore(snapshot)
        return restored, *estimates

    return after


def errors(estimates):
    """Return the distance of each target to its nearest estimate, shape (T,)."""
    return apart(position_at(seconds_of(estimates.stamp_ns)), estimates)


def apart(position, estimates):
    """Return the distances of positions to the nearest estimates."""
    distance = position[:, None] - estimates.position[None]
    return np.hypot(*distance.transpose(2, 0, 1)).min(axis=1, initial=np.inf)


def test_every_target_is_reported_once_a_revolution_at_a_common_stamp():
    _, filtered, smoothed = run()
    stamps = [round(seconds_of(estimates.stamp_ns), 6) for estimates in filtered]
    assert stamps == [ROTATION_S * revolution for revolution in range(1, 12)]
    assert [e.stamp_ns for e in smoothed] == [e.stamp_ns for e in filtered[: len(smoothed)]]
    for estimates in (*filtered[4:], *smoothed[3:]):
        assert len(estimates) == len(TARGETS)
        assert errors(estimates).max() < (200.0 if estimates.lag else 400.0)


def test_targets_keep_their_numbers_and_are_nearer_when_smoothed(default_run):
    _, filtered, smoothed = default_run(20)
    late, early = (
        np.mean([np.sqrt((errors(estimates) ** 2).mean()) for estimates in found[6:]])
        for found in (filtered, smoothed)
    )
    assert early < 0.8 * late
    _, filtered, _ = default_run(20)
    assert len({tuple(sorted(estimates.track_id)) for estimates in filtered[5:]}) == 1


def test_scan_leaves_targets_alone_that_the_antenna_did_not_pass(default_run):
    engine, _, _ = default_run(8)
    forward = engine.forward
    before = {rows.entry.stamp_ns: rows.entry.stored for rows in forward.unswept}
    alive = {row_label for rows in forward.unswept for row_label in rows.row_label.tolist()}
    engine.step(scans(9)[8 * SECTORS + 2])
    others = [rows for rows in forward.unswept[:-1] if rows.rows is None]
    assert len(others) >= 2
    for rows in others:
        assert rows.entry.stored is before[rows.entry.stamp_ns]
    now = {row_label for rows in forward.unswept for row_label in rows.row_label.tolist()}
    swept = {*forward.unswept[-1].entry.stored.row_label.tolist()}
    # Every target is in one place, and none is in two.
    assert sum(len({*rows.row_label.tolist()}) for rows in forward.unswept) == len(now)
    assert alive - swept <= now


def test_missed_target_is_missed_once_a_revolution_and_not_by_every_sector(default_run):
    engine, filtered, _ = default_run(10)
    reported, _ = stepped(engine, scans(11, missed=1.0)[10 * SECTORS :])
    # With p_D = 0.95 one miss leaves an existence probability near 0.95, sixteen would leave none.
    assert len(filtered[-1]) == len(reported[-1]) == len(TARGETS)
    mass = sum(rows.class_mass()[0] for rows in engine.forward.unswept)
    assert 3.0 < mass < 4.1


def test_target_that_is_gone_is_dropped(default_run):
    engine, _, _ = default_run(8)
    reported, _ = stepped(engine, scans(14, missed=1.0)[8 * SECTORS :])
    assert len(reported[-1]) == 0


def test_estimates_of_every_sector_are_all_at_its_stamp():
    engine, _, _ = run(6, estimates_period_s=0.0, lag=20)
    for scan in scans(7)[6 * SECTORS :]:
        (found,) = engine.step(scan).filtered
        assert found.stamp_ns == scan.stamp_ns
        assert len(found) == len(TARGETS)
        assert errors(found).max() < 400.0


def test_targets_are_reported_once_without_a_lag():
    _, filtered, smoothed = run(5, estimates_period_s=0.0, lag=0)
    assert len(smoothed) == len(filtered)
    for found in smoothed[-SECTORS:]:
        assert len(found) == len(TARGETS)
        assert errors(found).max() < 400.0


def test_window_is_as_long_as_the_lag_and_no_longer(default_run):
    engine, _, _ = default_run(20)
    assert len(engine._window) <= 6 * SECTORS
    linked = [entry for entry in engine._window if entry.link is not None]
    stamps = {entry.stamp_ns for entry in engine._window}
    assert all(any(s.stamp_ns in stamps for s in entry.sources) for entry in linked)


def test_lag_in_seconds_is_that_of_the_stamps():
    engine, filtered, smoothed = run(6, lag=5, lag_s=3.0 * ROTATION_S)
    assert len(filtered) - len(smoothed) == len(engine.flush()) == 3


def test_flush_gives_the_pending_stamps(default_run):
    engine, filtered, smoothed = default_run(12)
    assert [e.stamp_ns for e in [*smoothed, *engine.flush()]] == [e.stamp_ns for e in filtered]


def test_restored_engine_goes_on_as_if_it_had_never_stopped():
    lag_s = 3.0 * ROTATION_S
    restored_after([7 * SECTORS], lambda: engine_of(lag=5, lag_s=lag_s), scans(10))


@pytest.mark.parametrize("sectors", [4, 32])
def test_number_of_sectors_makes_no_difference_to_the_errors(default_run, sectors):
    def mean_square(filtered):
        return np.mean([(errors(e) ** 2).mean() for e in filtered[6:]])

    _, filtered, _ = run(LONGEST, sectors)
    found = mean_square(filtered) / mean_square(default_run(LONGEST)[1])
    assert 0.75 < np.sqrt(found) < 1.33


def test_sectors_and_whole_revolutions_with_plot_times_give_about_the_same_gaussians():
    def position_std(estimates):
        return np.sqrt(np.diagonal(estimates.covariance, axis1=1, axis2=2)[:, [0, 2]].T)

    pairs = zip(run(14)[1:], run(14, 1)[1:], strict=True)
    for first, (parts, revolutions) in zip((6, 4), pairs, strict=True):
        assert len(parts) == len(revolutions) > 2 * first
        for ours, theirs in zip(parts[first:], revolutions[first:], strict=True):
            assert len(ours) == len(theirs) == len(TARGETS)
            # A whole revolution is stamped in its middle and the plots move straight on within it.
            assert (apart(ours.position, theirs) < 0.5 * np.hypot(*position_std(ours))).all()
            if ours.lag:
                np.testing.assert_allclose(position_std(ours), position_std(theirs), rtol=0.2)


def test_smoothed_gaussians_that_later_sectors_did_not_sweep_are_filtered_ones():
    engine, _, _ = run(6, estimates_period_s=0.0, lag=20)
    window = engine._window
    later = {
        (source.stamp_ns, row)
        for entry in window
        for source in entry.sources
        for row in (range(source.size) if source.rows is None else source.rows.tolist())
    }
    unswept_rows = swept = 0
    for entry, smoothed in zip(window, backward_pass(window)[::-1], strict=True):
        for row in range(len(entry.stored)):
            same = np.array_equal(smoothed.mean[row], entry.stored.mean[row])
            if (entry.stamp_ns, row) in later:
                swept += not same
            else:
                assert same
                np.testing.assert_array_equal(smoothed.weight[row], entry.stored.weight[row])
                unswept_rows += 1
    assert unswept_rows > 3
    assert swept > 3
