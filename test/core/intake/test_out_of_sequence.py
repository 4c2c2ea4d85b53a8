"""Reports that come after their scan was closed: with rework nothing that follows shows it."""

import itertools
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
import sweep
from scenes import no_detections, short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine, new_pipeline
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.out_of_sequence import EARNED, MAX_SAVED, OutOfSequence
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import REPROCESSED, Stepped
from phd_jdtc_ros.core.types import Attributes, Estimates, Pose, SelfReports
from phd_jdtc_ros.simulation.simulate import simulate

SCANS = [scan for _, scan in simulate(short_scenario(16), 0)]
REPORTS = [
    (radar, scan.stamp_ns, detections, None)
    for scan in SCANS
    for radar, detections in enumerate(scan.detections)
]


class Run:
    """A pipeline and what came out of it, by stamp."""

    def __init__(self, config):
        self.given = []  # Handed over before the smoothing
        self.pipeline = new_pipeline(config, on_filtered=self.given.extend)
        self.filtered, self.smoothed, self.stepped, self.refused = [], [], [], []
        self.radars = len(config.inputs)

    def feed(self, reports):
        for report in reports:
            events = self.pipeline.add(*report)
            if isinstance(events, Rejection):
                self.refused.append(events)
            else:
                self.take(events)
        return self

    def take(self, events):
        for event in events:
            if isinstance(event, Stepped):
                self.stepped.append(event.scan.stamp_ns)
                self.filtered += event.step.filtered
                self.smoothed += event.step.smoothed
            else:
                self.smoothed += event.smoothed

    def finished(self):
        self.take(self.pipeline.flush())
        assert len(self.given) == len(self.filtered)
        assert all(map(same, self.given, self.filtered))
        return self

    @property
    def reprocessed(self):
        counts = [self.pipeline.take_anomalies(radar)[REPROCESSED] for radar in range(self.radars)]
        return sum(counts)


def late(reports, taken, by):
    """Return reports of which those of some indices come after so many others."""
    moved = [reports[index] for index in taken]
    rest = [report for index, report in enumerate(reports) if index not in taken]
    place = min(taken) + by
    return [*rest[:place], *moved, *rest[place:]]


def same(one, other, but=()):
    """Whether estimates are the same, bit by bit, but for some columns."""
    names = [each.name for each in fields(Estimates) if each.name not in (*but, "attributes")]
    pairs = [(getattr(one, name), getattr(other, name)) for name in names]
    if one.attributes is not None:
        names = [each.name for each in fields(Attributes)]
        pairs += [(getattr(one.attributes, n), getattr(other.attributes, n)) for n in names]
    return all(
        np.array_equal(mine, theirs, equal_nan=np.asarray(mine).dtype.kind == "f")
        for mine, theirs in pairs
    )


def from_stamp(estimates, stamp_ns):
    return {found.stamp_ns: found for found in estimates if found.stamp_ns > stamp_ns}


def assert_as_if_in_time(run, whole, worked_in_ns, smoothed_ns, but=()):
    """Check all filtered estimates after one stamp, and all smoothed ones after another."""
    for one, other, after_ns in (
        (run.filtered, whole.filtered, worked_in_ns),
        (run.smoothed, whole.smoothed, smoothed_ns),
    ):
        ours, theirs = from_stamp(one, after_ns), from_stamp(other, after_ns)
        assert ours.keys() == theirs.keys()
        assert len(ours) > 3
        assert all(same(ours[stamp_ns], theirs[stamp_ns], but) for stamp_ns in ours)


def config(given=None):
    return small({"lag": 4, "late_reports": "rework", **(given or {})})


@cache
def whole_run():
    """Return the run with all reports in time."""
    return Run(config()).feed(REPORTS).finished()


@pytest.mark.parametrize(
    "taken", [[13], [12, 13]], ids=["completes a scan", "is a scan of its own"]
)
def test_a_late_report_changes_nothing_that_is_still_to_come(taken):
    run = Run(config()).feed(late(REPORTS, taken, 5)).finished()
    whole = whole_run()
    assert (run.refused, run.reprocessed) == ([], len(taken))
    # It is of scan 6 and comes with scan 9, before which scan 4 has been smoothed.
    assert_as_if_in_time(run, whole, SCANS[8].stamp_ns, SCANS[5].stamp_ns)
    for kind in (run.filtered, run.smoothed):
        stamps = [found.stamp_ns for found in kind]
        assert stamps == sorted(set(stamps))
    assert [found.stamp_ns for found in run.smoothed] == [scan.stamp_ns for scan in SCANS]


def test_two_late_reports_are_processed_as_well_as_one():
    order = late(late(REPORTS, [10], 6), [19], 4)
    run = Run(config()).feed(order).finished()
    whole = whole_run()
    assert (run.refused, run.reprocessed) == ([], 2)
    assert_as_if_in_time(run, whole, SCANS[11].stamp_ns, SCANS[8].stamp_ns)


def test_a_late_report_at_the_end_is_in_the_pending_estimates():
    order = late(REPORTS, [27], 5)
    run = Run(config()).feed(order).finished()
    whole = whole_run()
    assert order[-1] == REPORTS[27] or order[-2] == REPORTS[27]
    ours, theirs = (from_stamp(each.smoothed, SCANS[12].stamp_ns) for each in (run, whole))
    assert len(ours) == len(theirs) == 3
    assert all(same(ours[stamp_ns], theirs[stamp_ns]) for stamp_ns in ours)


def test_a_late_report_may_wait_for_its_pose_with_later_ones():
    moving = {"pose": "/platform", "pose_max_age_s": 60.0}
    given = {f"radar_{n}.{name}": value for n in (1, 2) for name, value in moving.items()}
    settings = config(given)
    runs = []
    # Scans 6 and 7 close without report 13, and all three are released together.
    shuffled = [*REPORTS[:12], *(REPORTS[index] for index in (15, 12, 14, 13)), *REPORTS[16:]]
    for order in (REPORTS, shuffled):
        run = Run(settings)
        since_ns = SCANS[0].stamp_ns
        for last_ns, reports in ((SCANS[5].stamp_ns, order[:12]), (SCANS[-1].stamp_ns, order[12:])):
            run.feed(reports)
            for radar, pose_ns in itertools.product(
                range(2), range(since_ns, last_ns + 1, 500_000_000)
            ):
                run.take(run.pipeline.add_pose(radar, pose_ns, Pose((0.0, 0.0), 0.0)))
            since_ns = last_ns + 500_000_000
        runs.append(run.finished())
    assert (runs[1].refused, runs[1].reprocessed) == ([], 1)
    assert_as_if_in_time(runs[1], runs[0], SCANS[8].stamp_ns, SCANS[5].stamp_ns)


def test_what_comes_too_late_or_twice_is_refused():
    short = Run(config({"lag": 2})).feed(late(REPORTS, [13], 5)[:20])
    # Scan 6 has been smoothed with scan 8.
    assert short.refused == [Rejection.LATE]
    run = Run(config()).feed(REPORTS[:20]).feed([REPORTS[15]])
    assert run.refused == [Rejection.DUPLICATE]
    twice = Run(config()).feed([*late(REPORTS, [15], 4)[:20], REPORTS[15]])
    assert twice.refused == [Rejection.DUPLICATE]
    assert twice.reprocessed == 1


def test_rework_needs_a_lag_and_a_run():
    run = Run(config()).feed([*REPORTS[2:6], *REPORTS[:2]])
    assert run.refused == [Rejection.LATE, Rejection.LATE]
    with pytest.raises(ConfigError, match="late_reports: 'rework' given with lag 0"):
        config({"lag": 0})


def test_a_burst_is_limited_and_counted():
    between = [(1, stamp_ns + 1 + step, REPORTS[1][2], None) for step in range(100)
               for stamp_ns in [SCANS[7].stamp_ns]]  # fmt: skip
    run = Run(config()).feed([*REPORTS[:20], *between])
    window = 4
    most = MAX_SAVED * (window + 1)
    assert run.reprocessed < most
    assert set(run.refused) == {Rejection.LATE_BURST}
    assert len(run.refused) > 100 - most
    # One rework for all of them, and the next scan is stepped.
    run.feed(REPORTS[20:])
    assert run.stepped == [scan.stamp_ns for scan in SCANS]


def test_every_late_report_in_a_row_costs_no_more_than_is_earned(monkeypatch):
    # Radar 2 is two scans behind all the time.
    run = Run(config())
    steps = []
    step = run.pipeline.engine.step
    monkeypatch.setattr(
        run.pipeline.engine, "step", lambda scan, *rest: steps.append(scan) or step(scan, *rest)
    )
    order = sorted(REPORTS, key=lambda report: report[1] + report[0] * 13_000_000_000)
    run.feed(order)
    assert len(steps) <= (1.0 + EARNED) * len(run.stepped)
    assert run.reprocessed + len(run.refused) > 8


APPEARING = {
    "births": [],
    "detection_births.rates": [0.05, 0.05],
    "detection_births.std": [150.0],
}


def test_track_numbers_stay_when_targets_turn_out_to_be_born_earlier():
    # The first scan is empty. With the second, which is late, the targets are born there.
    empty = [(radar, stamp_ns, no_detections(), None) for radar, stamp_ns, *_ in REPORTS[:2]]
    order = late([*empty, *REPORTS[2:]], [2, 3], 4)
    run = Run(config(APPEARING)).feed(order[:6])
    assert run.reprocessed == 0
    before = run.filtered[-1]
    labels = run.pipeline.engine.snapshot().arrays["numbers.label"]
    run.feed(order[6:10])
    assert run.reprocessed == 2
    after = run.filtered[-1]
    kept = run.pipeline.engine.snapshot().arrays["numbers.label"]
    assert sorted(labels) != sorted(kept)
    dt = (after.stamp_ns - before.stamp_ns) * 1e-9
    expected = before.position + dt * before.velocity
    apart = np.hypot(*(expected[:, None] - after.position).transpose(2, 0, 1))
    nearest = apart.argmin(axis=1)
    # Not of a target that is gone: there another one is nearest.
    mutual = np.flatnonzero(apart.argmin(axis=0)[nearest] == np.arange(len(nearest)))
    assert len(mutual) >= 2
    numbers = after.track_id[nearest]
    assert numbers[mutual].tolist() == before.track_id[mutual].tolist()
    run.feed(order[10:]).finished()
    # No number is used for two targets: those of one number are at one place.
    places = {}
    for found in sorted(run.filtered + run.smoothed, key=lambda found: found.stamp_ns):
        for row, number in enumerate(found.track_id.tolist()):
            places.setdefault(number, []).append((found.stamp_ns * 1e-9, found.position[row]))
    for track in places.values():
        for (t, place), (later_t, later) in itertools.pairwise(track):
            assert np.hypot(*(later - place)) < 1000.0 + 150.0 * (later_t - t)


def test_a_change_of_the_parameters_within_the_window_stays_where_it_was():
    other = config({"cv.noise_density": 30.0})
    runs = []
    for order in (REPORTS, late(REPORTS, [13], 5)):
        run = Run(config())
        run.feed(order[:18])
        run.pipeline.engine.retune(other.model, other.rule)
        runs.append(run.feed(order[18:]).finished())
    whole, run = runs
    assert run.reprocessed == 1
    assert_as_if_in_time(run, whole, SCANS[8].stamp_ns, SCANS[5].stamp_ns)


def test_a_checkpoint_after_a_rework_is_one_of_the_timely_run():
    run, whole = Run(config()), Run(config())
    run.feed(late(REPORTS, [13], 5)[:22])
    whole.feed(REPORTS[:22])
    assert run.reprocessed == 1
    resumed = Run(config())
    snapshot = run.pipeline.engine.snapshot()
    resumed.pipeline = new_pipeline(config(), lambda engine, _: engine.restore(snapshot))
    resumed.feed(REPORTS[22:])
    whole.feed(REPORTS[22:])
    theirs = from_stamp(whole.filtered, SCANS[10].stamp_ns)
    assert len(resumed.filtered) == 5
    assert all(same(found, theirs[found.stamp_ns]) for found in resumed.filtered)


def test_codes_and_heights_are_those_of_the_timely_run():
    given = {
        f"{radar}.fields.{what}": what
        for radar in ("radar_1", "radar_2")
        for what in ("code", "height")
    }
    reports = [
        (
            radar,
            stamp_ns,
            replace(
                found,
                code=np.arange(len(found)) % 3,
                height=1000.0 + 50.0 * np.arange(len(found)) % 200.0,
            ),
            None,
        )
        for radar, stamp_ns, found, _ in REPORTS
    ]
    run = Run(config(given)).feed(late(reports, [13], 5)).finished()
    whole = Run(config(given)).feed(reports).finished()
    assert run.reprocessed == 1
    assert any(len(found) and (found.attributes.code >= 0).any() for found in whole.filtered)
    # False tracks have taken numbers that they would not have had.
    assert_as_if_in_time(run, whole, SCANS[8].stamp_ns, SCANS[5].stamp_ns, but=["track_id"])
    pairs = {
        pair
        for mine, theirs in zip(run.smoothed[6:], whole.smoothed[6:], strict=True)
        for pair in zip(mine.track_id.tolist(), theirs.track_id.tolist(), strict=True)
    }
    assert len(pairs) == len({mine for mine, _ in pairs}) == len({theirs for _, theirs in pairs})


REVOLUTIONS = 6
TURNING = {
    "late_reports": "rework",
    "lag_s": 2.0 * sweep.ROTATION_S,
    "radar.clutter_rate": 48.0,
}


@pytest.mark.parametrize(("timed", "period_s"), [(True, 0.0), (True, 1.7), (False, 1.7)])
def test_a_late_sector_changes_nothing_that_is_still_to_come(timed, period_s):
    given = {**TURNING, "estimates_period_s": period_s}
    reports = sweep.sector_reports(REVOLUTIONS, timed)
    # A sector of the fourth revolution comes six sectors late.
    index = 3 * sweep.SECTORS + 3
    run = Run(sweep.configuration(given)).feed(late(reports, [index], 6)).finished()
    whole = Run(sweep.configuration(given)).feed(reports).finished()
    assert (run.refused, run.reprocessed) == ([], 1)
    assert max(map(len, whole.smoothed)) == len(sweep.TARGETS)
    assert_as_if_in_time(run, whole, reports[index + 6][1], reports[index - 1][1])


def test_a_sector_that_comes_twice_or_before_all_is_refused():
    reports = sweep.sector_reports(REVOLUTIONS, timed=True)
    run = Run(sweep.configuration(TURNING))
    run.feed(reports[:80]).feed([reports[76], reports[40]])
    assert run.refused == [Rejection.DUPLICATE, Rejection.LATE]
    run.feed(reports[80:])
    assert run.reprocessed == 0
    assert len(run.refused) == 2


def test_self_reports_of_a_scan_that_loses_its_reports_join_the_next_one(monkeypatch):
    engine, again = new_engine(small({"lag": 6})), []
    reprocess = engine.reprocess
    monkeypatch.setattr(
        engine,
        "reprocess",
        lambda scans: again.extend(each for _, each in scans) or reprocess(scans),
    )
    rework = OutOfSequence(engine, 2, reprocesses=True)
    told = [SelfReports.of(np.array([scan.stamp_ns]), np.zeros((1, 2))) for scan in SCANS[:4]]
    for scan, own in zip(SCANS[:4], told, strict=True):
        rework.step(replace(scan, self_reports=own))
    for radar, moved in enumerate(SCANS[1].detections):
        rework.insert(radar, [SCANS[1].stamp_ns], [(SCANS[1].stamp_ns - 10**6, moved)])
    rework.finish()
    assert [scan.stamp_ns for scan in again] == [
        SCANS[1].stamp_ns - 10**6,
        *(scan.stamp_ns for scan in SCANS[2:4]),
    ]
    found = [scan.self_reports for scan in again]
    assert found[0] is None
    assert [each.time_ns.tolist() for each in found[1:]] == [
        [SCANS[1].stamp_ns, SCANS[2].stamp_ns],
        [SCANS[3].stamp_ns],
    ]
