"""Which tracks are reported, given their existence probabilities scan by scan."""

from dataclasses import replace

import numpy as np
import pytest
import sweep
from inner import resolve
from scenes import seen_with, small
from track_inputs import (
    MODEL,
    SHARP,
    beyond,
    estimates_of,
    missed_by,
    scan_of,
    spread_by,
    views_of,
)

from phd_jdtc_ros.configuration.engines import new_engine, new_pipeline
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import GATE_SIGMA
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, TENTATIVE, Detections, Scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

SECOND = 1_000_000_000
INTERVAL = 6 * SECOND
IN_SPACE = resolve(
    {"amplitude": "band", "state": "space", "radar_1.fields.elevation": "elevation"}
).model
# Survival probability of a target of the second class, with detection probability 0.88.
SURVIVAL = 0.99
SQUARE = Region(-10.0, 0.0, 10.0, 40.0, margin=5.0)


# Probability that both radars miss it.
MISSED = missed_by(scan_of(0))


class Tracks:
    """Existence probabilities of one track after another, scan by scan."""

    def __init__(self, model=MODEL, class_id=1, **thresholds):
        self.states = TrackStates(rule_of(model, True, **thresholds))
        self.model, self.class_id, self.index = model, class_id, 0

    def add(self, covariance=None, **found):
        """Report {tN: existence}, of a covariance; return the states of the reported tracks."""
        self.index += 1
        stamp_ns = self.index * INTERVAL
        given = {int(name[1:]): weight for name, weight in found.items()}
        every = estimates_of(stamp_ns, given, self.class_id, model=self.model)
        if covariance is not None:
            every = every.changed(covariance=np.tile(covariance, (len(every), 1, 1)))
        every = every.take(np.flatnonzero(every.weight > self.states.rule.least))
        swept = np.array([*given], dtype=np.int64) - 1
        held = [(self.index - back) * INTERVAL for back in range(2)]
        reported = self.states.report_filtered(
            every, swept, held, scan_of(stamp_ns, self.model), self.model, views_of(self.model)
        )
        self.states.note(reported)
        return dict(zip(reported.track_id.tolist(), reported.track_state.tolist(), strict=True))


def after_a_miss(existence, missed):
    survived = SURVIVAL * existence
    return survived * missed / (1.0 - survived * (1.0 - missed))


KEPT = after_a_miss(0.9999, MISSED)


def test_hysteresis_reports_each_track_until_its_deletion():
    tracks = Tracks(confirm=0.8, delete=0.3)
    found = [tracks.add(t1=weight) for weight in (0.7, 0.79, 0.81, 0.9, 0.4, 0.31, 0.29, 0.5, 0.85)]
    assert [list(states) for states in found] == [[], [], [1], [1], [1], [1], [], [], [1]]
    tracks = Tracks(confirm=0.8, delete=0.3)
    tracks.add(t1=0.9, t2=0.5)
    assert tracks.add(t1=0.5, t2=0.5) == {1: COASTING}
    assert tracks.add(t1=0.4, t2=0.9, t7=0.85) == {1: COASTING, 2: CONFIRMED, 7: CONFIRMED}


def test_a_confirmed_track_is_coasting_while_scans_miss_it():
    tracks = Tracks(confirm=0.6, delete=0.01)
    missed = after_a_miss(0.999, MISSED)
    weights = (0.9, 0.999, missed, 0.995, 0.999)
    assert [tracks.add(t1=w).get(1) for w in weights] == [
        CONFIRMED,
        CONFIRMED,
        COASTING,
        CONFIRMED,
        CONFIRMED,
    ]


def test_coasting_ends_at_even_odds_where_no_radar_looks():
    tracks = Tracks(confirm=0.6, delete=0.3)
    tracks.add(t1=0.999)
    tracks.model = beyond(MODEL)
    weights = 0.999 * SURVIVAL ** np.arange(1, 4)
    assert [tracks.add(t1=w)[1] for w in weights] == [CONFIRMED, COASTING, COASTING]
    tracks = Tracks()
    tracks.add(t1=0.999)
    tracks.model = beyond(MODEL)
    weights = SURVIVAL ** np.arange(1, 80)
    assert sum(1 in tracks.add(t1=weight) for weight in weights) == np.sum(weights >= 0.5)


def test_a_track_that_no_radar_can_see_is_reported_for_as_long_as_the_limit():
    tracks = Tracks(coasting_scans=4.0)
    tracks.add(t1=0.999)
    tracks.model = beyond(MODEL)
    weights = 0.999 * SURVIVAL ** np.arange(1, 8)
    assert [1 in tracks.add(t1=weight) for weight in weights] == [True] * 4 + [False] * 3
    tracks.model = MODEL
    assert tracks.add(t1=0.999) == {1: CONFIRMED}
    tracks.model = beyond(MODEL)
    assert tracks.add(t1=0.999 * SURVIVAL) == {1: CONFIRMED}


def test_a_limit_of_coasting_is_no_limit_where_radars_can_see_the_track():
    tracks = Tracks(model=seen_with(MODEL, 0.3), coasting_scans=1.0)
    tracks.add(t1=0.9999)
    missed = missed_by(scan_of(0), tracks.model)
    weights = [0.9999]
    for _ in range(4):
        weights.append(after_a_miss(weights[-1], missed))
    assert weights[-1] > 0.7
    assert [tracks.add(t1=weight)[1] for weight in weights[1:]] == [COASTING] * 4


@pytest.mark.parametrize("gates", [10.0, 40.0])
def test_a_track_that_is_spread_too_far_is_not_reported(gates):
    unit = spread_by(SHARP)[1]
    for share, reported in ((0.9, [COASTING]), (1.1, [])):
        tracks = Tracks(coasting_gates=gates)
        assert tracks.add(t1=0.999) == {1: CONFIRMED}
        width = share * 5.0 * gates / unit
        found = estimates_of(2 * INTERVAL, {1: 0.9999}).changed(
            covariance=np.array([width**2 * SHARP])
        )
        views, scan = views_of(MODEL), scan_of(2 * INTERVAL)
        given = (np.array([0]), (INTERVAL,), scan, MODEL, views)
        assert tracks.states.report_filtered(found, *given).track_state.tolist() == reported
        # Detected again it is narrow, and reported under the same label.
        tracks.index = 2
        assert tracks.add(t1=0.999) == {1: CONFIRMED}


@pytest.mark.parametrize(("gates", "state"), [(0.9, CONFIRMED), (1.1, COASTING)])
@pytest.mark.parametrize("model", [MODEL, IN_SPACE], ids=["plane", "space"])
def test_a_detection_that_leaves_a_track_wider_than_a_gate_is_not_its_own(model, gates, state):
    sharp = SHARP if model is MODEL else np.diag([*np.diag(SHARP), 1.0, 1.0])
    _, unit = spread_by(sharp, model)
    tracks = Tracks(model=model)
    assert tracks.add(t1=0.999) == {1: CONFIRMED}
    wide = (gates * GATE_SIGMA / unit) ** 2 * sharp
    assert tracks.add(wide, t1=0.9999) == {1: state}
    # The smoother says of that stamp what the filter said.
    smoothed = tracks.states.report_smoothed(estimates_of(2 * INTERVAL, {1: 0.999}, model=model))
    assert smoothed.track_state.tolist() == [state]
    assert tracks.add(t1=0.9999) == {1: CONFIRMED}


@pytest.mark.parametrize(("hidden", "reported"), [(4, 4), (14, 10)])
def test_a_target_that_comes_out_of_a_blind_sector_has_its_number(hidden, reported):
    # It flies past the radar, and after some scans behind something.
    before, after = 8, 4
    north = -2e3 + 240.0 * np.arange(before + hidden + after)
    edges = north[[before - 1, before + hidden - 1]] + 120.0
    radar = {
        "detection_probability": 0.95,
        "clutter_rate": 1.0,
        "position": [0.0, 0.0],
        "blind_sectors_deg": np.rad2deg(np.arctan2(edges, 8e3)).tolist(),
    }
    config = resolve(
        {
            "sensors": ["radar_1"],
            "births": [],
            "detection_births.rates": [0.05, 0.05],
            "lag": 1,
            **{f"radar_1.{name}": value for name, value in radar.items()},
        }
    )
    of, space = new_engine(config), config.model.modes.space
    (radar,) = config.model.radars
    tracks = []
    for index, place in enumerate(north):
        measured = radar.measure(space.state((8e3, place), (0.0, 40.0), 0.0)[None])
        measured = measured[radar.visibility.probability_in_view(measured) > 0.0]
        seen = Detections(measured, np.full(len(measured), 60.0))
        (found,) = of.step(Scan((index + 1) * INTERVAL, (seen,))).filtered
        tracks.append(found.track_id.tolist())
    (number,) = tracks[before - 1]
    assert tracks[before : before + reported] == [[number]] * reported
    assert tracks[before + reported : before + hidden] == [[]] * (hidden - reported)
    assert tracks[before + hidden :] == [[number]] * after


def test_a_track_that_was_never_missed_is_deleted_by_its_first_miss():
    new, old = Tracks(), Tracks()
    assert 0.55 < KEPT < 0.6
    for _ in range(3):
        new.add(t1=0.9999)
    for _ in range(60):
        old.add(t1=0.9999)
    assert new.add(t1=KEPT) == {1: COASTING}
    assert old.add(t1=KEPT) == {}


def test_a_track_that_is_missed_again_and_again_coasts_for_longer():
    tracks = Tracks()
    for _ in range(6):
        assert tracks.add(t1=0.9999) == {1: CONFIRMED}
        assert tracks.add(t1=KEPT) == {1: COASTING}
    usual = Tracks()
    usual.add(t1=0.9999)
    assert usual.add(t1=KEPT) == {1: COASTING}
    # A second miss in a row, if an uncertain one.
    twice = 3.0 * after_a_miss(KEPT, MISSED)
    assert twice < 0.1
    assert tracks.add(t1=twice) == {1: COASTING}
    assert usual.add(t1=twice) == {}


def test_no_record_keeps_a_track_that_hardly_exists():
    tracks = Tracks()
    for _ in range(20):
        tracks.add(t1=0.9999)
        tracks.add(t1=KEPT)
    tracks.add(t1=KEPT)
    assert tracks.add(t1=0.04) == {}


def test_given_deletion_is_of_the_existence_probability_alone():
    tracks = Tracks(delete=0.55)
    for _ in range(60):
        tracks.add(t1=0.9999)
    assert tracks.add(t1=0.56) == {1: COASTING}
    assert tracks.add(t1=0.54) == {}


def test_unlabelled_estimates_are_reported_above_one_threshold():
    config = resolve({"engine": "phd"})
    assert not config.rule.labelled
    assert config.rule.least == config.rule.least_smoothed == 0.5
    given = resolve({"engine": "phd", "existence": [0.7, 0.9]})
    assert given.rule.least == given.rule.least_smoothed == 0.7
    assert (given.rule.delete == 0.7).all()
    states = TrackStates(config.rule)
    found = estimates_of(SECOND, {0: 0.6})
    given = scan_of(SECOND), MODEL, views_of()
    assert states.report_filtered(found, np.zeros(0), (), *given) is found
    assert states.report_smoothed(found) is found
    assert found.track_state.tolist() == [CONFIRMED]


def test_smoothed_targets_are_reported_back_to_where_they_begin_to_exist():
    tracks = Tracks(confirm=0.8, delete=0.3)
    for weight in (0.2, 0.5, 0.9, 0.4, 0.2):
        tracks.add(t1=weight, t2=0.5)
    states = []
    for index, weight in enumerate((0.25, 0.99, 0.99, 0.99, 0.99), start=1):
        found = tracks.states.report_smoothed(
            estimates_of(index * INTERVAL, {1: weight, 2: 0.99}, lag=4)
        )
        states.append(dict(zip(found.track_id.tolist(), found.track_state.tolist(), strict=True)))
    # The second track was never confirmed; the first was deleted with the last scan.
    assert states == [{}, {1: TENTATIVE}, {1: CONFIRMED}, {1: COASTING}, {}]


def test_track_of_another_revolution_keeps_its_state_until_it_is_swept():
    tracks = Tracks(confirm=0.8, delete=0.3)
    tracks.add(t1=0.9, t2=0.9)
    tracks.add(t2=0.5)
    assert tracks.add(t1=0.5) == {1: COASTING}


def test_target_at_the_edge_of_a_slice_is_not_missed_by_the_other_slice():
    turning = tuple(replace(radar, rotation_s=48.0) for radar in MODEL.radars)
    tracks = Tracks(replace(MODEL, radars=turning), confirm=0.6, delete=0.1)
    missed = after_a_miss(0.999, MISSED)
    tracks.add(t1=0.9)
    tracks.add(t1=0.999)
    # Six seconds later, and then half a revolution of 48 s later.
    assert tracks.add(t1=missed) == {1: CONFIRMED}
    tracks.add(t1=missed - 0.01)
    tracks.add(t1=missed - 0.02)
    assert tracks.add(t1=missed - 0.03) == {1: COASTING}


def test_records_and_states_are_of_present_tracks_in_their_order():
    tracks = Tracks()
    for number in range(1, 200):
        tracks.add(**{f"t{number}": 0.9})
        tracks.states.forget_before((tracks.index - 5) * INTERVAL)
    assert len(tracks.states._records.label) <= 2
    assert len(tracks.states._noted.at) == 6


def test_records_of_tracks_that_a_scan_has_not_swept_remain_among_the_others():
    tracks = Tracks()
    tracks.add(t2=0.9, t4=0.9, t9=0.9)
    tracks.add(t4=0.9, t5=0.9)
    records = tracks.states._records
    assert records.label.tolist() == [2, 4, 5, 9]
    assert (records.stamp_ns // INTERVAL).tolist() == [1, 2, 2, 1]
    tracks.add(t5=0.9)
    assert tracks.states._records.label.tolist() == [4, 5]


def snapshot_of(tracks):
    snapshot = Snapshot(tracks.index * INTERVAL)
    tracks.states.to_snapshot(snapshot)
    return snapshot


def test_restored_states_go_on():
    first, second = Tracks(), Tracks()
    for weights in ((0.9, 0.2), (0.9999, 0.45), (KEPT, 0.45)):
        first.add(t1=weights[0], t2=weights[1])
    second.states.from_snapshot(snapshot_of(first))
    second.index = first.index
    for one, other in zip(first.states._records, second.states._records, strict=True):
        np.testing.assert_array_equal(one, other)
    assert first.add(t1=0.4, t2=0.45) == second.add(t1=0.4, t2=0.45)
    stamp_ns = 2 * INTERVAL
    ours, theirs = (
        t.states.report_smoothed(estimates_of(stamp_ns, {1: 0.9, 2: 0.9})) for t in (first, second)
    )
    np.testing.assert_array_equal(ours.track_state, theirs.track_state)


def test_the_engine_reports_a_missed_target_as_coasting():
    config = resolve({"amplitude": "band"})
    scans = [scan for _, scan in simulate(paper_scenario(config.model.radars), 3)[:12]]
    scans[9] = scan_of(scans[9].stamp_ns)  # Nothing is detected
    of = new_engine(config)
    states = []
    for scan in scans:
        (found,) = of.step(scan).filtered
        states.append(dict(zip(found.track_id.tolist(), found.track_state.tolist(), strict=True)))
    assert len(states[8]) == 3
    assert set(states[8].values()) == {CONFIRMED}
    # Targets of high signal-to-noise ratio are never missed, so these are gone.
    assert list(states[9].values()) == [COASTING]
    assert states[9].keys() < states[8].keys()
    (track,) = states[9]
    assert states[10][track] == CONFIRMED


def test_depth_is_the_distance_to_the_nearest_side():
    places = np.array([[0.0, 20.0], [9.0, 20.0], [0.0, 1.0], [12.0, 20.0], [12.0, -7.0]])
    assert SQUARE.depth(places).tolist() == [10.0, 1.0, 1.0, -2.0, -7.0]
    assert SQUARE.covers(places).tolist() == [True, True, True, True, False]


def test_detections_beyond_the_margin_are_dropped():
    radar = small().model.radars[0]
    place = np.array([[0.0, 20.0], [14.0, 20.0], [16.0, 20.0], [0.0, 46.0]])
    line = place - np.asarray(radar.position)
    azimuth = np.arctan2(line[:, 1], line[:, 0]) - radar.yaw
    amplitude = np.arange(4.0)
    seen = Detections(np.stack([np.hypot(*line.T), azimuth], axis=1), amplitude)
    kept = SQUARE.select_detections(seen, radar)
    assert kept.amplitude.tolist() == [0.0, 1.0]
    assert Region(-1e3, -1e3, 1e3, 1e3).select_detections(seen, radar) is seen


@pytest.mark.parametrize(
    "given", [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0, 0.0]], ids=str
)
def test_a_region_that_is_none_is_refused(given):
    with pytest.raises(ConfigError, match=r"region: .* must be empty or"):
        small({"region": given})


def test_a_rate_that_is_learned_is_that_of_a_whole_field():
    given = {"region": [0.0, 0.0, 1.0, 1.0], "radar_2.learn": ["clutter"]}
    with pytest.raises(ConfigError, match=r"radar_2\.learn: clutter given, must be left out"):
        small(given)


@pytest.mark.parametrize("late_reports", ["drop", "rework"])
def test_a_tracker_of_a_region_has_the_targets_in_it_and_no_others(late_reports):
    # Two of the four targets are east of the seam, all the time.
    given = {"estimates_period_s": 1.7, "lag_s": 4.0}
    region = {"region": [0.0, -90e3, 90e3, 90e3, 2e3]}
    found = {}
    for name, more in (("whole", {}), ("east", region)):
        config = sweep.configuration({**given, **more, "late_reports": late_reports})
        pipeline, steps = new_pipeline(config), []
        reports = sweep.sector_reports(5, timed=True)
        # One is late, and is cut and limited in its place.
        reports.insert(55, reports.pop(50))
        for report in reports:
            events = pipeline.add(*report)
            if not isinstance(events, Rejection):
                steps += [event for event in events if isinstance(event, Stepped)]
        for step in steps:
            assert name == "whole" or all(
                (config.region.select_detections(report, config.model.radars[0]) is report)
                for report in step.scan.detections
            )
        found[name] = [one for step in steps for one in step.step.filtered]
        smoothed = [one for event in pipeline.flush() for one in event.smoothed]
        assert name == "whole" or all((one.position[:, 0] >= -2e3).all() for one in smoothed)
    for whole, east in zip(found["whole"][-4:], found["east"][-4:], strict=True):
        assert whole.stamp_ns == east.stamp_ns
        truth = sweep.position_at(sweep.seconds_of(east.stamp_ns))[[0, 3]]
        assert (truth[:, 0] > 0.0).all()
        for estimates in (whole, east):
            apart = np.hypot(*(truth[:, None] - estimates.position).transpose(2, 0, 1))
            assert (apart.min(axis=1) < 500.0).all()
        assert (east.position[:, 0] >= -2e3).all()
        assert (whole.position[:, 0] < -2e3).sum() >= 2
