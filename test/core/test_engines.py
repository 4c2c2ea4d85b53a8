"""Both engines: restored ones go on as if never stopped, and radars whose scans are sectors."""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from runs import ENGINES, assert_same, equal, restored_after, stepped, stored_and_read
from scenes import short_scenario, small
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

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

PROFILE = resources.find(Path("config/surveillance.yaml"))
SCANS = [scan for _, scan in simulate(short_scenario(10), 3)]
CASES = [
    *(
        {"engine": "gaussian", "lag": lag, **given}
        for lag in (0, 3)
        for given in (
            {},
            {"amplitude": "band"},
            {"spawn.rate": 0.0, "births": [], "detection_births.rates": [0.1, 0.1]},
        )
    ),
    *(
        {"engine": engine, "lag": lag, "recursion.extraction": extraction}
        for lag, extraction in ((0, "components"), (3, "components"), (2, "clusters"))
        for engine in ("particles", "phd")
    ),
]
PERIOD = {"estimates_period_s": ROTATION_S, "lag": 3}
# Turns of the run with the defaults, and those after which tests go on from it.
LONGEST = 24
COPIED = (8, 10, 12, 20, LONGEST)


@pytest.mark.parametrize("given", CASES, ids=lambda given: "-".join(map(str, given.values())))
def test_restored_engine_goes_on_as_if_it_had_never_stopped_bit_by_bit(given):
    first, second = restored_after([0, 1, 6], lambda: new_engine(small(given)), SCANS)
    assert equal(first.flush(), second.flush())


def test_few_targets_in_little_clutter_are_tracked_by_the_general_profile():
    # Sets of one hypothesis and of none, beside newborn ones.
    config = resolve(sections.read(PROFILE).values("/tracker"))
    for seed in range(12):
        clutter_rate = (0.05, 0.5, 2.0)[seed % 3]
        radars = [
            radar.changed(clutter_rate=clutter_rate)
            for radar in polar_radars(resolve({}).model.radars)
        ]
        scene = paper_scenario(radars)
        scene = replace(scene, scans=16, targets=scene.targets[: seed % 3])
        tracker = new_engine(config)
        for _, scan in simulate(scene, seed):
            for estimates in tracker.step(scan).filtered:
                assert np.isfinite(estimates.state).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_snapshot_is_not_changed_by_what_the_engine_does_later(engine):
    tracker = new_engine(small({"engine": engine, "lag": 2}))
    stepped(tracker, SCANS[:4])
    snapshot = tracker.snapshot()
    before = stored_and_read(snapshot)
    stepped(tracker, SCANS[4:])
    assert_same(snapshot, before)


def without(name):
    return lambda snapshot: snapshot.arrays.pop(name)


def shortened(name):
    return lambda snapshot: snapshot.arrays.update({name: snapshot.arrays[name][:-1]})


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (without("stored.0.mode"), "stored.0.mode"),
        (without("stored.1.components.indptr"), "stored.1.components.indptr"),
        (shortened("stored.1.origin"), "stored.1"),
        (shortened("stored.1.label"), "stored.1"),
        (shortened("stored.1.link.survival"), "stored.1.link"),
        (without("filter.scan_index"), "filter.scan_index: missing"),
        (lambda snapshot: snapshot.json_values.update({"extraction.rng": {}}), "snapshot"),
    ],
)
def test_restore_refuses_what_is_no_particle_engine_and_leaves_a_new_one(change, named):
    engine, fresh = (new_engine(small({"engine": "particles", "lag": 2})) for _ in range(2))
    stepped(engine, SCANS[:4])
    snapshot = engine.snapshot()
    change(snapshot)
    engine = new_engine(small({"engine": "particles", "lag": 2}))
    with pytest.raises(ValueError, match=named):
        engine.restore(snapshot)
    assert equal(stepped(engine, SCANS[:4])[0], stepped(fresh, SCANS[:4])[0])


@pytest.fixture(scope="module", params=ENGINES)
def name(request):
    return request.param


def engine_of(name, **given):
    return new_engine(configuration({**PERIOD, "engine": name, **given}))


def run(name, turns=12, sectors=SECTORS, **given):
    """Return the engine after the scans, and all filtered and smoothed estimates."""
    engine = engine_of(name, **given)
    return engine, *stepped(engine, scans(turns, sectors=sectors))


@pytest.fixture(scope="module")
def default_run(name):
    """Return a run with the defaults, by the number of its turns; engines may be changed."""
    engine, filtered, smoothed, at = engine_of(name), [], [], {}
    every = scans(LONGEST)
    for turn in range(1, LONGEST + 1):
        estimates = stepped(engine, every[(turn - 1) * SECTORS : turn * SECTORS])
        filtered, smoothed = filtered + estimates[0], smoothed + estimates[1]
        if turn in COPIED:
            at[turn] = copy.deepcopy(engine), filtered, smoothed
    return lambda turns: copy.deepcopy(at[turns])


def errors(estimates):
    """Return the distance of each target to its nearest estimate, shape (T,)."""
    return apart(position_at(seconds_of(estimates.stamp_ns)), estimates)


def apart(position, estimates):
    """Return the distances of positions to the nearest estimates."""
    distance = position[:, None] - estimates.position[None]
    return np.hypot(*distance.transpose(2, 0, 1)).min(axis=1, initial=np.inf)


def test_every_target_is_reported_once_a_turn_at_a_common_stamp(name):
    _, filtered, smoothed = run(name, particles_per_target=400)
    stamps = [round(seconds_of(estimates.stamp_ns), 6) for estimates in filtered]
    assert stamps == [ROTATION_S * turn for turn in range(1, 12)]
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


def test_missed_target_is_missed_once_a_turn_and_not_by_every_sector(default_run):
    engine, filtered, _ = default_run(10)
    reported, _ = stepped(engine, scans(11, missed=1.0)[10 * SECTORS :])
    # p_D is 0.95: one miss leaves an existence probability near 0.95, sixteen would leave none.
    assert len(filtered[-1]) == len(reported[-1]) == len(TARGETS)
    mass = sum(rows.class_mass(np.zeros(2, dtype=int), 1)[0] for rows in engine.forward.unswept)
    assert 3.0 < mass < 4.1


def test_target_that_is_gone_is_dropped(default_run):
    engine, _, _ = default_run(8)
    reported, _ = stepped(engine, scans(14, missed=1.0)[8 * SECTORS :])
    assert len(reported[-1]) == 0


def test_estimates_of_every_sector_are_all_at_its_stamp(name):
    engine, _, _ = run(name, 6, estimates_period_s=0.0, lag=20)
    for scan in scans(7)[6 * SECTORS :]:
        (found,) = engine.step(scan).filtered
        assert found.stamp_ns == scan.stamp_ns
        assert len(found) == len(TARGETS)
        assert errors(found).max() < 400.0


def test_targets_are_reported_once_without_a_lag(name):
    _, filtered, smoothed = run(name, 5, estimates_period_s=0.0, lag=0)
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


def test_lag_in_seconds_is_that_of_the_stamps(name):
    engine, filtered, smoothed = run(name, 6, lag=f"{3.0 * ROTATION_S:g} s")
    assert len(filtered) - len(smoothed) == len(engine.flush()) == 3


def test_flush_gives_the_pending_stamps(default_run):
    engine, filtered, smoothed = default_run(12)
    assert [e.stamp_ns for e in [*smoothed, *engine.flush()]] == [e.stamp_ns for e in filtered]


def test_restored_engine_goes_on_as_if_it_had_never_stopped(name):
    lag = f"{3.0 * ROTATION_S:g} s"
    restored_after([7 * SECTORS], lambda: engine_of(name, lag=lag), scans(10))


@pytest.mark.parametrize("sectors", [4, 32])
def test_number_of_sectors_makes_no_difference_to_the_errors(default_run, name, sectors):
    def mean_square(filtered):
        return np.mean([(errors(e) ** 2).mean() for e in filtered[6:]])

    _, filtered, _ = run(name, LONGEST, sectors)
    found = mean_square(filtered) / mean_square(default_run(LONGEST)[1])
    assert 0.75 < np.sqrt(found) < 1.33


def test_sectors_and_whole_turns_with_plot_times_give_about_the_same_gaussians():
    def position_std(estimates):
        return np.sqrt(np.diagonal(estimates.covariance, axis1=1, axis2=2)[:, [0, 2]].T)

    pairs = zip(run("gaussian", 14)[1:], run("gaussian", 14, 1)[1:], strict=True)
    for first, (parts, turns) in zip((6, 4), pairs, strict=True):
        assert len(parts) == len(turns) > 2 * first
        for ours, theirs in zip(parts[first:], turns[first:], strict=True):
            assert len(ours) == len(theirs) == len(TARGETS)
            # A whole turn is stamped in its middle and the plots move straight on within it.
            assert (apart(ours.position, theirs) < 0.5 * np.hypot(*position_std(ours))).all()
            if ours.lag:
                np.testing.assert_allclose(position_std(ours), position_std(theirs), rtol=0.2)


def test_smoothed_gaussians_that_later_sectors_did_not_sweep_are_filtered_ones():
    engine, _, _ = run("gaussian", 6, estimates_period_s=0.0, lag=20)
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


def seen_at(seconds, targets, coverage=None):
    """Return the scan of some targets' plots, without errors."""
    x, y = position_at(seconds)[targets].T
    found = Detections(np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1), None, None)
    stamp_ns = START_NS + round(seconds * 1e9)
    return Scan(stamp_ns, (replace(found, coverage=coverage),))


def test_newborn_particles_of_one_set_are_drawn_again_one_after_the_other_and_stay_so():
    engine = engine_of("particles")
    engine.step(seen_at(0.0, [0, 1]))
    ((rows, born),) = [(rows, rows.entry.stored) for rows in engine.forward.unswept]
    drawn = []
    for seconds, target in ((4.0, 0), (4.5, 1)):
        (x, y) = position_at(seconds)[target]
        engine.step(seen_at(seconds, [target], Coverage(np.arctan2(y, x) - 0.2, 0.4)))
        (entry,) = [each for each in engine._window if each.stamp_ns == rows.entry.stamp_ns]
        changed = (entry.stored.state != born.state).any(axis=1)
        drawn.append(
            (
                set(born.row_label[changed]),
                entry.stored.state[born.row_label == min(born.row_label)],
            )
        )
    (first, of_first), (both, later_of_first) = drawn
    # The first one's velocities are those that its next detection was explained with.
    assert len(first) == 1
    assert len(both) == 2
    np.testing.assert_array_equal(later_of_first, of_first)
