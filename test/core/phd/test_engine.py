"""The engine of every PHD filter: window, lag, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from paper_room import plain, small
from runs import alike, equal, stepped
from scenes import no_detections, short_scenario

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.configuration.parameters.tracker import PHD
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.targets import TargetScript

SCANS = [scan for _, scan in simulate(short_scenario(8), 3)]
THREE_CLASSES = {
    "classes": ["strong", "weak", "turning"],
    "strong.snr_band_db": [30.0, 50.0],
    "weak.snr_band_db": [10.0, 30.0],
    "weak.motions": ["cv"],
    "weak.mode_transition": [1.0],
    "turning.snr_band_db": [10.0, 30.0],
    "turning.motions": ["ct"],
    "turning.mode_transition": [1.0],
    **{f"start_{n}.rates": [0.005, 0.003, 0.002] for n in range(1, 5)},
}
every_engine = pytest.mark.parametrize("engine", PHD)


def engine_of(engine, given=None):
    return new_engine(small({"engine": engine, "lag": 2, **(given or {})}))


def run(engine, scans=SCANS):
    """Return the filtered, the smoothed and the flushed estimates of a run."""
    return *stepped(engine, scans), list(engine.flush())


@every_engine
@pytest.mark.parametrize("end", ["reset", "flush", "interrupt"])
def test_engine_gives_the_same_run_for_the_same_seed_and_after_an_end(engine, end):
    used = engine_of(engine, {"seed": 7})
    stepped(used, SCANS[:5])
    getattr(used, end)()
    first, second = run(used), run(engine_of(engine, {"seed": 7}))
    assert alike(first, second)
    assert sum(len(found) for found in first[0]) > len(SCANS)
    assert all((found.track_id == 0).all() for kind in first for found in kind)


@every_engine
def test_engine_smooths_each_scan_once_with_the_scans_of_its_lag(engine):
    filtered, smoothed, flushed = run(engine_of(engine, {"lag": 3}))
    stamps = [scan.stamp_ns for scan in SCANS]
    assert [found.stamp_ns for found in filtered] == stamps
    assert [found.stamp_ns for found in [*smoothed, *flushed]] == stamps
    assert [found.lag for found in [*smoothed, *flushed]] == [3] * 5 + [2, 1, 0]


@every_engine
def test_engine_smooths_by_a_lag_in_seconds(engine):
    # Scans are 6 s apart.
    _, smoothed, flushed = run(engine_of(engine, {"lag": 5, "lag_s": 10.0}))
    assert [found.lag for found in [*smoothed, *flushed]] == [2] * 6 + [1, 0]


@every_engine
@pytest.mark.parametrize("lag", [0, 1])
def test_engine_filters_alike_whatever_the_lag(engine, lag):
    filtered, smoothed, _ = run(engine_of(engine, {"lag": lag}))
    reference = run(engine_of(engine, {"lag": 5}))[0]
    assert equal(filtered, reference)
    assert len(smoothed) == len(SCANS) - lag


@every_engine
def test_engine_gives_filtered_estimates_before_the_smoothing(engine, monkeypatch):
    order, tracker = [], engine_of(engine, {"lag": 1})
    backward_step = tracker.recursion.backward_step

    def spied(*arguments):
        order.append("backward")
        return backward_step(*arguments)

    monkeypatch.setattr(tracker.recursion, "backward_step", spied)
    for scan in SCANS[:2]:
        tracker.step(scan, lambda found: order.append(found[0].stamp_ns))
    assert order == [SCANS[0].stamp_ns, SCANS[1].stamp_ns, "backward"]


@every_engine
def test_smoothed_window_has_every_lag_newest_first(engine):
    tracker = engine_of(engine, {"lag": 4})
    for scan in SCANS[:4]:
        tracker.step(scan)
    found = list(tracker.smoothed())
    assert [each.stamp_ns for each in found] == [scan.stamp_ns for scan in SCANS[3::-1]]
    assert equal(found[::-1], tracker.flush())


@every_engine
def test_engine_goes_on_after_a_refused_stamp(engine):
    refused, unchanged = engine_of(engine), engine_of(engine)
    for tracker in (refused, unchanged):
        tracker.step(SCANS[0])
    with pytest.raises(ValueError, match="not later"):
        refused.step(SCANS[0])
    assert equal(refused.step(SCANS[1]).filtered[0], unchanged.step(SCANS[1]).filtered[0])


@every_engine
def test_engine_does_not_update_with_a_radar_that_did_not_report(engine):
    # A missing report is no evidence of absence, and a report without detections is.
    silent, empty = engine_of(engine), engine_of(engine)
    for tracker in (silent, empty):
        for scan in SCANS[:4]:
            tracker.step(scan)
    stamp_ns, nothing = SCANS[4].stamp_ns, no_detections()
    unheard = silent.step(Scan(stamp_ns, (None, None))).class_mass.sum()
    unseen = empty.step(Scan(stamp_ns, (nothing, nothing))).class_mass.sum()
    assert 2.7 < unheard < 3.5
    assert unseen < 0.3 * unheard


@every_engine
def test_engine_of_one_mode_tracks_a_target(engine):
    config = plain({"engine": engine, "radar.clutter_rate": 3.0, "lag": 2, "particles": [0, 512]})
    target = TargetScript(0, 1e4, (8e3, 6e3), (-30.0, 20.0), 0, 5)
    scene = replace(short_scenario(6), targets=(target,), radars=config.model.radars)
    tracker = new_engine(config)
    for index, (truth, scan) in enumerate(simulate(scene, 1)):
        step = tracker.step(scan)
        if index < 2:
            continue
        assert [len(found) for found in (step.filtered[0], step.smoothed[0])] == [1, 1]
        error = step.filtered[0].state[0, [0, 2]] - truth.state[0, [0, 2]]
        assert np.hypot(*error) < 700.0  # Twice the radar's own error


@every_engine
def test_engine_runs_three_classes_and_no_births(engine):
    filtered, smoothed, flushed = run(engine_of(engine, THREE_CLASSES))
    assert filtered[-1].class_probability.shape[1] == 3
    assert len(filtered[-1]) == 3
    assert len(smoothed) + len(flushed) == len(SCANS)
    filtered, smoothed, flushed = run(engine_of(engine, {"births": []}))
    assert all(len(found) == 0 for found in [*filtered, *smoothed, *flushed])


@every_engine
def test_engine_keeps_no_state_to_return_to(engine):
    tracker = engine_of(engine)
    tracker.step(SCANS[0])
    for refused in (
        tracker.save_state,
        tracker.snapshot,
        lambda: tracker.restore(None),
        lambda: tracker.reprocess([]),
    ):
        with pytest.raises(ValueError, match="a PHD filter keeps no state"):
            refused()
    assert tracker.clutter_raster() is None


@every_engine
def test_engine_uses_another_model_from_the_next_scan_on(engine):
    config = small({"engine": engine, "lag": 1})
    tracker = new_engine(config)
    tracker.step(SCANS[0])
    for scan in SCANS[1:4]:
        assert len(tracker.step(scan).filtered[0]) > 0
    rule = replace(config.rule, reported=np.zeros(2, dtype=bool))
    # Without survivors, spawned targets and births there is no mass.
    given = {"births": [], "spawn.rate": 0.0}
    given |= {f"class_{index}.survival_probability": 1e-9 for index in range(2)}
    tracker.retune(config.model, rule)
    step = tracker.step(SCANS[4])
    assert len(step.filtered[0]) == 0
    assert step.class_mass.sum() > 1.0
    tracker.retune(small({"engine": engine, **given}).model, config.rule)
    assert tracker.step(Scan(SCANS[5].stamp_ns, (None, None))).class_mass.sum() < 1e-6


def test_particles_are_at_most_those_of_the_budget_however_long_unseen():
    # No detection shows that they no longer exist, or which targets they spawned.
    scene = short_scenario(60)
    targets = tuple(
        replace(target, turns=(), first_scan=0, last_scan=59) for target in scene.targets
    )
    silent = [Scan(scan.stamp_ns, (None, None)) for _, scan in simulate(scene, 3)]
    scans = [scan for _, scan in simulate(replace(scene, targets=targets), 3)]
    most, given = 900, {"budget.least": 200}
    tracker = new_engine(small({**given, "budget.most": most}))
    usual = new_engine(small(given))
    for scan in [*scans[:8], *silent[8:]]:
        found, unbounded = tracker.step(scan), usual.step(scan)
    assert unbounded.figures["particles"] > 1.5 * most
    assert found.figures["particles"] <= 1.1 * most
