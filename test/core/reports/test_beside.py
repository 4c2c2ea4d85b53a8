"""The layer of self-reports through the pipeline, on a small harbour."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from harbour import (
    CLONE,
    DARK,
    KINDS,
    LIAR,
    LIES_S,
    OFFSET,
    OK,
    START_NS,
    TURN_S,
    configured,
    turns,
)
from runs import stored_and_read

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.reports import judgement
from phd_jdtc_ros.core.reports.bias import CERTAIN
from phd_jdtc_ros.core.reports.tables import concatenate, take
from phd_jdtc_ros.core.types import CONFIRMED, TENTATIVE, SelfReports
from phd_jdtc_ros.core.types.reports import ALARM, ICAO, LEFT, MMSI, SHARED


def fed(pipeline, scene, reports=lambda turn: turn.reports):
    """Return the filtered estimates by turn, and the smoothed ones."""
    filtered, smoothed = [], []
    for turn in scene:
        if (told := reports(turn)) is not None:
            pipeline.add_reports(0, told)
        for event in pipeline.add(0, turn.stamp_ns, turn.plots):
            filtered += event.step.filtered
            smoothed += event.step.smoothed
    return filtered, smoothed


@cache
def tracked(seed=1, told=True, seconds=300.0):
    """Return the pipeline after a scene, the scene, and its estimates."""
    pipeline, scene = new_pipeline(configured()), turns(seed, seconds)
    estimates = fed(pipeline, scene, (lambda turn: turn.reports) if told else lambda turn: None)
    return pipeline, scene, *estimates


def nearest(estimates, place, alone=0):
    """Return the row of the radar track, or the track of reports alone, nearest to a place."""
    (rows,) = (estimates.reports.alone == alone).nonzero()
    return rows[np.argmin(np.hypot(*(estimates.position[rows] - place).T))]


def test_reports_change_nothing_of_the_engine():
    with_reports, without = (tracked(told=told)[0].engine.snapshot() for told in (True, False))
    names = {name for name in with_reports.arrays if not name.startswith("reports.")}
    assert names == {name for name in without.arrays if not name.startswith("reports.")}
    for name in names - {"numbers.label", "numbers.number", "numbers.last"}:
        np.testing.assert_array_equal(with_reports.arrays[name], without.arrays[name])


def test_tracks_without_a_source_are_the_radars_own():
    fused, alone = tracked()[2], tracked(told=False)[2]
    for ours, theirs in zip(fused, alone, strict=True):
        (own,) = (ours.reports.alone == 0).nonzero()
        assert len(own) == len(theirs)
        untouched = own[ours.reports.owned[own] == 0.0]
        rows = np.searchsorted(own, untouched)
        np.testing.assert_array_equal(ours.state[untouched], theirs.state[rows])
        np.testing.assert_array_equal(ours.covariance[untouched], theirs.covariance[rows])


def test_equipped_ships_are_more_accurate_and_their_antennas_known():
    errors, radar = {OK: [], DARK: []}, {OK: [], DARK: []}
    for seed in (1, 2):
        for filtered, errors_of in ((tracked(seed)[2], errors), (tracked(seed, False)[2], radar)):
            scene = tracked(seed)[1]
            for turn, estimates in zip(scene[40:], filtered[40:], strict=True):
                for kind, place in zip(KINDS, turn.truth, strict=True):
                    if kind in errors_of:
                        row = nearest(estimates, place)
                        errors_of[kind].append(np.sum((estimates.position[row] - place) ** 2))
    rms = {kind: np.sqrt(np.mean(each)) for kind, each in errors.items()}
    alone = {kind: np.sqrt(np.mean(each)) for kind, each in radar.items()}
    assert rms[OK] < 0.7 * alone[OK]
    assert rms[DARK] == alone[DARK]
    last, place = tracked()[2][-1], tracked()[1][-1].truth[KINDS.index(OK)]
    assert last.reports.offset[nearest(last, place), 0] == pytest.approx(OFFSET, abs=15.0)


def frequent(scene, seed=1):
    """Return what the ships of straight ways would report of themselves every half a second."""
    rng, velocity = np.random.default_rng(seed), (scene[1].truth - scene[0].truth) / TURN_S

    def told(turn):
        late_s, ship = np.repeat(np.arange(5) / 2.0, len(velocity)), np.tile([*range(6)], 5)
        place = turn.truth[ship] - late_s[:, None] * velocity[ship]
        return SelfReports.of(
            turn.stamp_ns - (late_s * 1e9).astype(np.int64),
            place + rng.normal(0.0, 8.0, place.shape),
            velocity=velocity[ship] + rng.normal(0.0, 0.2, place.shape),
            address=1001 + ship,
            space=np.full(len(ship), MMSI),
        )

    return told


def test_straight_ways_are_no_evidence_against_owners():
    """Tracks that may turn hard expect reports of a steady ship less well than its last ones do."""
    pipeline, scene = new_pipeline(configured({"cv.noise_density": 4.0})), turns(5, 150.0, [OK] * 6)
    filtered, _ = fed(pipeline, scene, frequent(scene))
    for estimates, turn in zip(filtered[20:], scene[-len(filtered) + 20 :], strict=True):
        for place in turn.truth:
            assert estimates.reports.owned[nearest(estimates, place)] > ALARM


def test_pairs_follow_the_liveliest_motion_however_rare_it_is():
    rare = {
        "motions": ["cv", "hard"],
        "hard.model": "constant_velocity",
        "hard.noise_density": 3.0,
        "ship.motions": ["cv", "hard"],
        "ship.mode_transition": [0.999, 0.001, 0.2, 0.8],
    }
    assert configured(rare).model.noise_density == pytest.approx(3.0)


def test_a_source_is_tentative_while_a_radar_may_still_confirm_it():
    """It is so too if it is silent after its first two reports, and then does not coast."""
    pipeline, scene = new_pipeline(configured({"ais.identity": "icao"})), turns(6, 20.0, [OK] * 6)
    first = frequent(scene)(scene[0])
    away = first.changed(position=first.position + 1500.0, space=np.full(len(first), ICAO))
    filtered, _ = fed(pipeline, scene, lambda turn: away if turn is scene[0] else None)
    states = np.concatenate([each.track_state[each.reports.alone == 1] for each in filtered])
    assert len(states)
    assert (states == TENTATIVE).all()


def test_a_biased_radar_is_corrected_in_pairs_by_what_reports_say():
    """The radar's ranges are 30 m too large and its azimuths 0.6 degrees too small."""
    wrong = np.array([30.0, np.radians(-0.6)])
    scene = [
        turn._replace(plots=replace(turn.plots, measurement=turn.plots.measurement + wrong))
        for turn in turns(5, 150.0, [OK] * 6)
    ]
    pipeline = new_pipeline(configured({"ais.identity": "icao", "ais.offset_std": 5.0}))
    told = frequent(scene)

    def addressed(turn):
        found = told(turn)
        return found.changed(space=np.full(len(found), ICAO))

    filtered, _ = fed(pipeline, scene, addressed)
    for estimates, turn in zip(filtered[-20:], scene[-20:], strict=True):
        for place in turn.truth:
            row = nearest(estimates, place)
            assert estimates.reports.owned[row] > ALARM
            assert np.hypot(*(estimates.position[row] - place)) < 15.0
    information, total, _ = pipeline.engine.forward.factors.reports.biases
    # Of standard deviations of 12 m and 0.3 degrees.
    found = np.linalg.solve(information[0], total[0]) * [12.0, np.radians(0.3)]
    np.testing.assert_allclose(found, wrong, rtol=0.1)


def test_antennas_off_the_middle_are_no_bias_of_a_radar():
    for seed in (1, 2):
        information, total, _ = tracked(seed)[0].engine.forward.factors.reports.biases
        assert total[0] @ np.linalg.solve(information[0], total[0]) < CERTAIN


def test_smoothed_estimates_of_equipped_ships_are_as_accurate_as_filtered_ones():
    _, scene, filtered, smoothed = tracked()
    by_stamp = {each.stamp_ns: each for each in smoothed}
    of_filter, of_smoother = [], []
    for turn, estimates in zip(scene[40:], filtered[40:], strict=True):
        if turn.stamp_ns in by_stamp:
            for place in turn.truth[:2]:
                for each, out in ((estimates, of_filter), (by_stamp[turn.stamp_ns], of_smoother)):
                    out.append(np.sum((each.position[nearest(each, place)] - place) ** 2))
    assert np.mean(of_smoother) < np.mean(of_filter)


def test_dark_ships_are_called_and_no_other_one():
    _, scene, filtered, _ = tracked()
    for turn, estimates in zip(scene[50:], filtered[50:], strict=True):
        for kind, place in zip(KINDS, turn.truth, strict=True):
            dark = estimates.reports.dark[nearest(estimates, place)]
            assert dark > ALARM if kind == DARK else dark < 0.9


def test_a_ship_is_as_dark_as_it_is_not_the_owner_of_a_report_that_another_one_may_own():
    pipeline, scene, *_ = tracked()
    layer, stamp_ns = pipeline.engine.forward.factors.reports, scene[-1].stamp_ns
    tracks, pairs = layer.tracks, layer.pairs

    def track_of(kind):
        place = scene[-1].truth[KINDS.index(kind)]
        return int(np.argmin(np.hypot(*(tracks.mean[:, :2] - place).T)))

    owner, dark = track_of(OK), track_of(DARK)
    assert judgement.of_receiver(layer, 0, stamp_ns).dark[dark] > ALARM
    (own,) = (pairs.label == tracks.label[owner]).nonzero()
    assert pairs.owned[own].sum() > 0.99
    other = take(pairs, own)
    other = other._replace(label=np.full(len(own), tracks.label[dark]), owned=0.3 * other.owned)
    shared = pairs._replace(owned=np.where(pairs.label == tracks.label[owner], 0.7, 1.0))
    said = judgement.of_receiver(layer.changed(pairs=concatenate([shared, other])), 0, stamp_ns)
    assert said.dark[dark] == pytest.approx(0.7, abs=0.01)
    assert said.dark[owner] == pytest.approx(0.3, abs=0.01)


def test_liar_is_called_and_does_not_pull_its_ship():
    _, scene, filtered, _ = tracked()
    late = START_NS + round((LIES_S + 60.0) * 1e9)
    alone = tracked(told=False)[2]
    ship, called = KINDS.index(LIAR), 0
    for turn, estimates, radar in zip(scene, filtered, alone, strict=True):
        if turn.stamp_ns < late:
            continue
        reports = estimates.reports
        (ghost,) = ((reports.alone == 1) & (reports.address == 1001 + ship)).nonzero()
        # Its path is cut where its places do not fit its velocities.
        called += LEFT in reports.reason[ghost]
        assert (reports.doubtful[ghost] > ALARM).all()
        assert (estimates.track_state[ghost] == TENTATIVE).all()
        row = nearest(estimates, turn.truth[ship])
        assert reports.reason[row] == LEFT
        assert reports.dark[row] == 0.0
        assert "left by MMSI 1004" in reports.reason_text(row, turn.stamp_ns)
        own = np.argmin(np.hypot(*(radar.position - turn.truth[ship]).T))
        np.testing.assert_allclose(estimates.position[row], radar.position[own], atol=1.0)
    assert called >= 0.9 * np.count_nonzero([turn.stamp_ns >= late for turn in scene])


def test_a_beacon_that_no_radar_sees_is_a_track_and_not_doubtful():
    scene, pipeline = turns(2, 150.0, kinds=(OK,)), new_pipeline(configured())
    beacon, ship = 972_110_001, 211_000_001

    def told(turn):
        own, away = turn.reports, np.full(len(turn.reports), 1500.0)
        parts = [
            own.changed(address=np.full(len(own), each), position=own.position + k * away[:, None])
            for k, each in enumerate((beacon, ship), start=1)
        ]
        return SelfReports.concatenate([own, *parts])

    said = fed(pipeline, scene, told)[0][-1]
    at = {int(number): row for row, number in enumerate(said.reports.address)}
    assert said.reports.doubtful[at[ship]] > ALARM
    assert np.isnan(said.reports.doubtful[at[beacon]])
    assert said.weight[at[beacon]] == 1.0
    assert said.track_state[at[beacon]] == CONFIRMED


def test_clones_are_two_sources():
    _, scene, filtered, _ = tracked()
    clones = np.flatnonzero([kind == CLONE for kind in KINDS])
    for turn, estimates in zip(scene[40:], filtered[40:], strict=True):
        rows = [nearest(estimates, turn.truth[ship]) for ship in clones]
        assert len(set(rows)) == 2
        assert (estimates.reports.owned[rows] > 0.9).all()
        assert len(set(estimates.reports.address[rows].tolist())) == 1
        # Each is told to be one of two, and no other ship is.
        assert (estimates.reports.reason[rows] == SHARED).all()
        assert np.count_nonzero(estimates.reports.reason == SHARED) == 2


def test_order_of_reports_within_a_scan_does_not_matter():
    rng = np.random.default_rng(0)
    shuffled, _ = fed(
        new_pipeline(configured()),
        turns(1),
        lambda turn: turn.reports.take(rng.permutation(len(turn.reports))),
    )
    for ours, theirs in zip(shuffled, tracked()[2], strict=True):
        np.testing.assert_array_equal(ours.state, theirs.state)
        np.testing.assert_array_equal(ours.reports.doubtful, theirs.reports.doubtful)


def test_late_reports_count_as_late():
    """The same reports, each two scans late: the estimates are nearly those of punctual ones."""
    scene = turns(1)
    waiting = [scene[0].reports.take(np.zeros(0, dtype=np.int64))] * 2
    late, _ = fed(
        new_pipeline(configured()),
        scene,
        lambda turn: (waiting.append(turn.reports), waiting[len(waiting) - 3])[1],
    )
    for ours, theirs, turn in zip(late[60:], tracked()[2][60:], scene[60:], strict=True):
        place = turn.truth[KINDS.index(OK)]
        rows = nearest(ours, place), nearest(theirs, place)
        assert ours.reports.owned[rows[0]] > 0.9
        np.testing.assert_allclose(
            ours.position[rows[0]], theirs.position[rows[1]], atol=15.0, rtol=0.0
        )


def test_snapshot_continues_as_if_it_had_never_stopped():
    scene, middle = turns(1), 70
    whole = new_pipeline(configured())
    fed(whole, scene[:middle])
    snapshot = stored_and_read(whole.engine.snapshot())
    other = new_pipeline(configured())
    other.engine.restore(snapshot)
    assert_same_estimates(fed(whole, scene[middle:]), fed(other, scene[middle:]))


def assert_same_estimates(ours, theirs):
    for one, another in zip(ours, theirs, strict=True):
        for mine, other in zip(one, another, strict=True):
            np.testing.assert_array_equal(mine.track_id, other.track_id)
            np.testing.assert_array_equal(mine.state, other.state)
            np.testing.assert_array_equal(mine.reports.dark, other.reports.dark)


def test_forged_snapshots_are_refused():
    pipeline, _, _, _ = tracked()
    stored = pipeline.engine.snapshot().arrays
    for name in [n for n in stored if n.startswith("reports.")]:
        if not stored[name].size:
            continue
        forged = stored_and_read(pipeline.engine.snapshot())
        array = forged.arrays[name].copy()
        array.ravel()[0] = np.nan if array.dtype.kind == "f" else -(1 << 40)
        forged.arrays[name] = array
        with pytest.raises(ValueError, match="snapshot"):
            new_pipeline(configured()).engine.restore(forged)


def test_reprocessing_replays_the_reports_of_the_scans():
    more = {"late_reports": "rework", "lag": 6}
    scene = turns(3, 120.0)
    pipeline = new_pipeline(configured(more))
    events = []
    for index, turn in enumerate(scene):
        pipeline.add_reports(0, turn.reports)
        if index != 40:
            events += list(pipeline.add(0, turn.stamp_ns, turn.plots))
        if index == 42:
            late = scene[40]
            assert list(pipeline.add(0, late.stamp_ns, late.plots)) == []
    events += list(pipeline.flush())
    punctual = new_pipeline(configured(more))
    filtered, _ = fed(punctual, scene)
    steps = [event for event in events if isinstance(event, Stepped)]
    ours, theirs = steps[-1].step.filtered[-1], filtered[-1]
    assert len(ours) == len(theirs)
    for row in range(len(theirs)):
        near = np.argmin(np.hypot(*(ours.position - theirs.position[row]).T))
        np.testing.assert_allclose(ours.position[near], theirs.position[row], atol=1.0)
        assert ours.reports.address[near] == theirs.reports.address[row]


def test_a_receiver_that_dies_makes_nothing_dark():
    scene, pipeline = turns(2), new_pipeline(configured())
    dies = START_NS + round(100.0 * 1e9)
    filtered, _ = fed(pipeline, scene, lambda turn: turn.reports if turn.stamp_ns < dies else None)
    last, truth = filtered[-1], scene[-1].truth
    for kind, place in zip(KINDS, truth, strict=True):
        if kind != DARK:
            assert last.reports.dark[nearest(last, place)] < 0.1


def test_without_coverage_a_source_is_a_track_of_its_own_with_one_number():
    scene, pipeline = turns(1, 200.0), new_pipeline(configured())

    def told(turn):
        time_s = (turn.stamp_ns - START_NS) * 1e-9
        # It comes in from far beyond the radar's range of 12 km.
        place = np.array([[0.0, 14_000.0 - 8.0 * time_s]])
        return SelfReports.of(
            np.array([turn.stamp_ns]),
            place,
            velocity=np.array([[0.0, -8.0]]),
            address=np.array([77]),
            space=np.array([MMSI]),
        )

    filtered, _ = fed(pipeline, scene, told)
    found = [each.take(np.flatnonzero(each.reports.address == 77)) for each in filtered[3:]]
    assert all(len(each) == 1 for each in found)
    assert all(each.reports.alone[0] and np.isnan(each.reports.doubtful[0]) for each in found)
    assert len({int(each.track_id[0]) for each in found}) == 1
    np.testing.assert_allclose(found[-1].position[0], [0.0, 12_400.0], atol=30.0)


def flood(turn, count, **columns):
    """Return reports of one turn, all at one time unless columns say otherwise."""
    rng = np.random.default_rng(turn.stamp_ns % 1000)
    given = {"address": np.full(count, 1001), "space": np.full(count, MMSI)} | columns
    place = rng.uniform(-5000.0, 5000.0, (count, 2))
    return SelfReports.of(np.full(count, turn.stamp_ns), place, **given)


def test_floods_are_bounded():
    scene, pipeline = turns(1, 15.0), new_pipeline(configured())
    begin_s = time.process_time()
    for turn in scene:
        told = SelfReports.concatenate(
            [
                flood(turn, 10_000),
                flood(turn, 3000, address=np.arange(3000) + turn.stamp_ns % 9973 * 3000),
                turn.reports,
            ]
        )
        pipeline.add_reports(0, told)
        list(pipeline.add(0, turn.stamp_ns, turn.plots))
    layer = pipeline.engine.forward.factors.reports
    assert len(layer.sources.number) <= 10_000
    assert np.bincount(np.unique(layer.pairs.source, return_inverse=True)[1]).max() <= 4
    assert np.count_nonzero(layer.sources.address == 1001) <= 8
    assert time.process_time() - begin_s < 60.0


def test_a_stream_of_another_continent_is_harmless():
    scene, pipeline = turns(1, 100.0), new_pipeline(configured())

    def told(turn):
        far = flood(turn, 500, address=np.arange(5000, 5500))
        return SelfReports.concatenate([turn.reports, far.changed(position=far.position + 8e6)])

    filtered, _ = fed(pipeline, scene, told)
    usual, _ = fed(new_pipeline(configured()), scene)
    for ours, theirs in zip(filtered, usual, strict=True):
        known = ours.take(np.flatnonzero(np.abs(ours.position).max(axis=1) < 1e6))
        np.testing.assert_array_equal(known.state, theirs.state)


def test_times_that_stand_still_are_one_report():
    scene = turns(1, 100.0, kinds=(OK,))
    first = {}

    def still(turn):
        reports = turn.reports
        if len(reports):
            first.setdefault("time_ns", reports.time_ns[:1])
            first.setdefault("position", reports.position[:1])
            return reports.changed(**{name: each.copy() for name, each in first.items()})
        return reports

    pipeline = new_pipeline(configured({"ais.max_age_s": 600.0}))
    fed(pipeline, scene, still)
    sources = pipeline.engine.forward.factors.reports.sources
    assert sources.reports.tolist() == [1]


def test_a_clock_that_stands_still_makes_no_ship_dark():
    scene, ship = turns(2), KINDS.index(OK)
    address, stopped_ns = 1001 + ship, START_NS + round(100.0 * 1e9)

    def still(turn):
        told = turn.reports
        late = (told.address == address) & (told.time_ns > stopped_ns)
        return told.changed(time_ns=np.where(late, stopped_ns, told.time_ns))

    def off(turn):
        told = turn.reports
        late = (told.address == address) & (told.time_ns > stopped_ns)
        return told.take(np.flatnonzero(~late))

    dark = []
    for reports in (still, off):
        last = fed(new_pipeline(configured()), scene, reports)[0][-1]
        dark.append(last.reports.dark[nearest(last, scene[-1].truth[ship])])
    assert dark[0] < 0.1
    assert dark[1] > ALARM


def test_one_ship_with_two_addresses_and_two_ships_with_one():
    scene, pipeline = turns(2, 200.0, kinds=(OK, CLONE, CLONE)), new_pipeline(configured())

    def doubled(turn):
        mine = turn.reports.take(np.flatnonzero(turn.reports.address == 1001))
        return SelfReports.concatenate(
            [turn.reports, mine.changed(address=np.full(len(mine), 2001))]
        )

    filtered, _ = fed(pipeline, scene, doubled)
    last = filtered[-1]
    assert np.count_nonzero(last.reports.alone == 0) == 3
    # Both addresses own the ship, which shows one of them.
    row = nearest(last, scene[-1].truth[0])
    assert last.reports.address[row] in (1001, 2001)
    assert last.reports.reason[row] != SHARED


def test_stamps_of_one_run_are_those_of_the_radar():
    _, scene, filtered, _ = tracked()
    assert [each.stamp_ns for each in filtered] == [turn.stamp_ns for turn in scene]
    assert pytest.approx((scene[1].stamp_ns - scene[0].stamp_ns) * 1e-9) == TURN_S
