from dataclasses import replace

import numpy as np
import pytest
from antennas import (
    START_NS,
    S,
    TurningRadar,
    absolute,
    covered,
    degrees_off,
    fed,
    revolutions_of,
    widest_gap,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.intake.revolution_history import RevolutionHistory
from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.sectors import slices_per_revolution
from phd_jdtc_ros.core.types import Detections

SLICES = slices_per_revolution(4.0)
REPORTS = TurningRadar(sectors=8, plots=80).reports(8)


@pytest.mark.parametrize(("rotation_s", "timed"), [(0.0, False), (4.0, False), (0.0, True)])
def test_a_report_without_times_or_of_a_radar_that_does_not_turn_stays_as_it_is(rotation_s, timed):
    sent = TurningRadar(timed=timed).reports(1)[0]
    ((stamp_ns, piece),) = Revolutions(rotation_s).split(sent.stamp_ns, sent.detections)
    assert stamp_ns == sent.stamp_ns
    assert piece is sent.detections


@pytest.mark.parametrize(
    ("period_s", "fine", "slices"), [(2.5, False, 3), (12.0, False, 8), (2.5, True, 8)]
)
def test_slices_are_short_and_fine_ones_shorter(period_s, fine, slices):
    assert slices_per_revolution(period_s, fine) == slices


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("stamp_at", [0.0, 0.5, 1.0, 1.3, -0.5])
@pytest.mark.parametrize("cut", [0.0, 3.0])
def test_a_revolution_becomes_slices_that_share_it(clockwise, stamp_at, cut):
    radar = TurningRadar(clockwise=clockwise, stamp_at=stamp_at, cut=cut)
    reports = radar.reports(5)
    stamps = []
    for revolution, pieces in enumerate(fed(revolutions_of(radar), reports)):
        assert len(pieces) == SLICES
        assert (np.abs(covered(pieces) - 1.0) > 0.0).mean() < 0.01
        for stamp_ns, piece in pieces:
            stamps.append((stamp_ns - START_NS) / S)
            assert np.abs(piece.time_s).max(initial=0.0) < 4.0 / 2 / SLICES + 0.02
            # It is where the antenna was then.
            middle = radar.phase(piece.coverage.start + 0.5 * piece.coverage.width)
            away = middle - cut - 2.0 * np.pi * stamps[-1] / 4.0
            assert abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi) < 0.05
        assert 4.0 * revolution - 0.1 < stamps[-SLICES] < stamps[-1] < 4.0 * (revolution + 1) + 0.1
    assert (np.diff(stamps) > 0.0).all()


@st.composite
def turning_radars(draw):
    rotation_s = draw(st.sampled_from([1.0, 2.5, 4.0, 12.0]))
    # A revolution that is not cut has times, otherwise there is nothing to do.
    sectors = draw(st.sampled_from([0, 2, 3, 4, 8, 16, 32]))
    return TurningRadar(
        rotation_s=rotation_s,
        sectors=sectors,
        clockwise=draw(st.booleans()),
        # Halves of revolutions without times come in the same order whichever way the antenna
        # turns.
        timed=sectors <= 2 or draw(st.booleans()),
        stamp_at=draw(st.floats(-0.5, 1.5)),
        cut=draw(st.floats(0.0, 6.0)),
        plots=draw(st.sampled_from([60, 150])),
        noise=draw(st.sampled_from([0.001, 0.01])),
        time_step_s=draw(st.sampled_from([0.0, 1.0 / 128.0])),
    )


@settings(deadline=None, max_examples=60)
@given(radar=turning_radars(), seed=st.integers(0, 10**6), drift=st.floats(-0.03, 0.03))
def test_what_the_antenna_passed_is_covered_once_and_little_else(radar, seed, drift):
    rng = np.random.default_rng(seed)
    # An antenna is heavy: from one revolution to the next its speed changes by little.
    lengths = radar.rotation_s * np.exp(drift + 0.003 * rng.standard_normal(5).cumsum())
    reports = radar.reports(5, seed, lengths)
    revolutions, last_ns = revolutions_of(radar), 0
    off = []
    for sent in reports:
        pieces = revolutions.split(sent.stamp_ns, sent.detections)
        off.append(degrees_off(sent, pieces))
        for stamp_ns, piece in pieces:
            assert stamp_ns > last_ns
            last_ns = stamp_ns
            assert not any(
                array.flags.writeable
                for array in (piece.measurement, piece.time_s)
                if array is not None
            )
        found = sorted(row for stamp_ns, piece in pieces for row in absolute(stamp_ns, piece))
        wanted = absolute(sent.stamp_ns, sent.detections)
        assert [row[0] for row in found] == [row[0] for row in wanted]
        if radar.timed:
            np.testing.assert_allclose(
                [row[1] for row in found], [row[1] for row in wanted], atol=2.0
            )
    # Two revolutions until the sectors' edges are learned. Where there are no detections, nothing
    # shows an edge.
    settled = off[2 * radar.per_revolution :]
    assert max(settled) < widest_gap(reports, radar.per_revolution)
    assert np.mean(settled) < 15.0
    assert not +revolutions.anomalies


@pytest.mark.parametrize("few", [0, 1, 2])
def test_revolutions_with_few_detections_go_on_with_the_phase_of_those_before(few):
    radar = TurningRadar()
    revolutions, reports = revolutions_of(radar), radar.reports(12)
    before = fed(revolutions, reports[:4])[-1]
    for revolution, sent in enumerate(reports[4:]):
        chosen = np.arange(len(sent.detections))[:few]
        pieces = revolutions.split(sent.stamp_ns, sent.detections.take(chosen))
        assert len(pieces) == SLICES
        assert (np.abs(covered(pieces) - 1.0) > 0.0).mean() < 0.01
        for (stamp_ns, piece), (first_ns, first) in zip(pieces, before, strict=True):
            assert abs((stamp_ns - first_ns) / S - 4.0 * (revolution + 1)) < 0.05
            assert abs(np.sin(0.5 * (piece.coverage.start - first.coverage.start))) < 0.02
    assert not +revolutions.anomalies


def test_the_first_revolutions_are_whole_until_slices_follow_the_reports():
    radar = TurningRadar()
    sent = radar.reports(1)[0]
    few = sent.detections.take(np.array([3, 40]))
    ((stamp_ns, piece),) = revolutions_of(radar).split(sent.stamp_ns, few)
    assert (stamp_ns, piece.coverage) == (sent.stamp_ns, None)
    np.testing.assert_array_equal(piece.time_s, few.time_s)
    radar = TurningRadar(sectors=4, plots=80, stamp_at=3.0)
    revolutions = Revolutions()
    stamps = [stamp_ns for pieces in fed(revolutions, radar.reports(8)) for stamp_ns, _ in pieces]
    assert revolutions.period_s > 0.0
    assert (np.diff(stamps) > 0).all()


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.1, 1.25])
def test_a_revolution_that_changes_its_speed_is_followed(factor):
    radar = TurningRadar()
    lengths = [4.0, 4.0, 4.0, *[4.0 * factor] * 4]
    revolutions = revolutions_of(radar)
    for revolution, pieces in enumerate(fed(revolutions, radar.reports(7, lengths=lengths))):
        # In the first revolutions of another length that length is still being learned.
        learning = revolution in (3, 4)
        assert abs(len(pieces) - SLICES) <= learning
        assert (np.abs(covered(pieces) - 1.0) > 0.0).mean() < (0.05 if learning else 0.01)
        longest = max(np.abs(piece.time_s).max(initial=0.0) for _, piece in pieces)
        assert longest < 4.0 * max(factor, 1.0) / 2 / SLICES + 0.1
    assert not +revolutions.anomalies


def test_revolutions_cut_by_time_and_not_by_azimuth_are_covered_as_they_are_passed():
    # The antenna needs 3.9 s, the clouds come every 4 s: each is a little more than a revolution.
    whole = TurningRadar(rotation_s=3.9, plots=400).reports(12)
    times = np.concatenate([(s.stamp_ns - START_NS) / S + s.detections.time_s for s in whole])
    rows = np.concatenate([s.detections.measurement for s in whole])
    revolutions, total = Revolutions(3.9), np.zeros(1)
    for k in range(1, 11):
        inside = (times >= 4.0 * (k - 1)) & (times < 4.0 * k)
        cloud = Detections(rows[inside], None, times[inside] - 4.0 * k)
        total = total + covered(revolutions.split(START_NS + 4 * k * S, cloud))
    assert abs(total.mean() - 40.0 / 3.9) < 0.1
    assert not +revolutions.anomalies


def test_a_duplicate_is_rejected_and_changes_nothing():
    radar = TurningRadar()
    reports = radar.reports(3)
    revolutions, plain = revolutions_of(radar), revolutions_of(radar)
    fed(revolutions, reports[:2])
    assert revolutions.split(reports[1].stamp_ns, reports[1].detections) is Rejection.DUPLICATE
    assert revolutions.split(reports[0].stamp_ns, reports[0].detections) is Rejection.LATE
    fed(plain, reports[:2])
    ours, others = fed(revolutions, reports[2:])[0], fed(plain, reports[2:])[0]
    assert [stamp_ns for stamp_ns, _ in ours] == [stamp_ns for stamp_ns, _ in others]


def test_a_jump_back_begins_a_new_run_that_is_cut_like_the_first():
    radar = TurningRadar()
    reports = radar.reports(6)
    revolutions = revolutions_of(radar)
    first, second = fed(revolutions, reports), fed(revolutions, reports)
    for ours, others in zip(first, second, strict=True):
        assert [stamp_ns for stamp_ns, _ in ours] == [stamp_ns for stamp_ns, _ in others]


@pytest.mark.parametrize("sectors", [0, 4, 16])
def test_lost_reports_are_counted_and_not_covered(sectors):
    radar = TurningRadar(sectors=sectors, timed=True)
    reports = radar.reports(8)
    lost = 3 * radar.per_revolution + 1 if sectors else 3
    revolutions = revolutions_of(radar)
    kept = [sent for k, sent in enumerate(reports) if k not in (lost, lost + 1)]
    for sent, pieces in list(zip(kept, fed(revolutions, kept), strict=True))[
        2 * radar.per_revolution :
    ]:
        assert degrees_off(sent, pieces) < 5.0
    assert +revolutions.anomalies == {"clouds_missing": 2}


@pytest.mark.parametrize(
    ("wrong_s", "counted"), [(4.0, ""), (-4.0, "detections_late"), (1.7, "times_disagree")]
)
def test_times_that_do_not_go_with_the_azimuth_are_kept_and_counted(wrong_s, counted):
    radar = TurningRadar(noise=0.0005, time_step_s=0.0)
    revolutions, reports = revolutions_of(radar), radar.reports(6)
    fed(revolutions, reports[:3])
    sent = reports[3]
    chosen = np.arange(len(sent.detections))[::8]
    time_s = sent.detections.time_s.copy()
    time_s[chosen] += wrong_s
    wrong = replace(sent.detections, time_s=time_s)
    pieces = revolutions.split(sent.stamp_ns, wrong)
    found = sorted(row for stamp_ns, piece in pieces for row in absolute(stamp_ns, piece))
    wanted = absolute(sent.stamp_ns, wrong)
    assert [row[0] for row in found] == [row[0] for row in wanted]
    np.testing.assert_allclose([row[1] for row in found], [row[1] for row in wanted], atol=2.0)
    # A time that is a revolution off goes with its azimuth: nobody can tell, and nothing follows
    # from it.
    assert +revolutions.anomalies == ({counted: len(chosen)} if counted else {})
    for slices in [pieces, *fed(revolutions, reports[4:])]:
        assert (np.abs(covered(slices) - 1.0) > 0.0).mean() < 0.01


def test_times_in_any_order_make_no_difference():
    radar = TurningRadar()
    reports = radar.reports(3)
    order = np.random.default_rng(1)
    shuffled = [
        replace(s, detections=s.detections.take(order.permutation(len(s.detections))))
        for s in reports
    ]
    for ours, others in zip(
        fed(revolutions_of(radar), reports), fed(revolutions_of(radar), shuffled), strict=True
    ):
        for (stamp_ns, piece), (other_ns, other) in zip(ours, others, strict=True):
            assert abs(stamp_ns - other_ns) < 0.001 * S
            assert sorted(piece.measurement[:, 0]) == sorted(other.measurement[:, 0])


@pytest.mark.parametrize("count", [12, 60])
@pytest.mark.parametrize("seed", range(4))
def test_whole_revolutions_without_times_do_not_show_a_slower_antenna(count, seed):
    revolutions, rng = Revolutions(2.5), np.random.default_rng(seed)
    azimuth, rate = rng.uniform(-np.pi, np.pi, count), 0.01 * rng.standard_normal(count)
    for k in range(100):
        seen = azimuth[rng.random(count) < 0.8]
        report = Detections(np.stack([np.full(len(seen), 5e3), seen], axis=1), None)
        stamp_ns = START_NS + round(2.5e9 * k)
        assert revolutions.split(stamp_ns, report) == [(stamp_ns, report)]
        azimuth = np.remainder(azimuth + rate, 2.0 * np.pi)
    assert revolutions.period_s == 2.5
    assert not +revolutions.anomalies


def test_two_antennas_back_to_back_are_not_cut_and_counted():
    radar = TurningRadar()
    revolutions = revolutions_of(radar)
    for sent in radar.reports(5):
        turned = sent.detections.measurement.copy()
        turned[::2, 1] += np.pi
        ((stamp_ns, piece),) = revolutions.split(
            sent.stamp_ns, replace(sent.detections, measurement=turned)
        )
        assert (stamp_ns, piece.coverage) == (sent.stamp_ns, None)
    assert revolutions.anomalies["antenna_unclear"] == 5


def test_an_antenna_that_stops_covers_only_where_it_points_and_is_found_again():
    radar = TurningRadar()
    revolutions = revolutions_of(radar)
    reports = radar.reports(14)
    fed(revolutions, reports[:4])
    for sent in reports[4:8]:
        still = sent.detections.measurement.copy()
        still[:, 1] = 1.0 + 0.01 * np.sin(np.arange(len(still)))
        pieces = revolutions.split(sent.stamp_ns, replace(sent.detections, measurement=still))
        assert covered(pieces).mean() < 0.02
    assert revolutions.anomalies["antenna_unclear"] == 4
    later = fed(revolutions, reports[8:])
    for pieces in later[2:]:
        assert len(pieces) == SLICES
        assert (np.abs(covered(pieces) - 1.0) > 0.0).mean() < 0.01


def test_an_antenna_that_turns_the_other_way_is_found_again():
    radar = TurningRadar()
    revolutions = revolutions_of(radar)
    fed(revolutions, radar.reports(4))
    back = replace(radar, clockwise=True).reports(9)[4:]
    for pieces in fed(revolutions, back)[2:]:
        assert len(pieces) == SLICES
        assert (np.abs(covered(pieces) - 1.0) > 0.0).mean() < 0.02


def still(kind, rng):
    """Return the detections of a cloud of a radar that does not turn, a second long."""
    count = rng.poisson(12)
    time_s = np.sort(rng.uniform(-1.0, 0.0, count))
    azimuth = {
        "all around": rng.uniform(-np.pi, np.pi, count),
        "ahead": rng.uniform(-0.5, 0.5, count),
        "at one place": 0.7 + 0.01 * rng.standard_normal(count),
        # It swings from side to side, or looks from one side to the other again and again.
        "scanning": 1.0 * np.sin(2.0 * np.pi * time_s),
        "sweeping": 2.0 * time_s + 1.0,
    }[kind]
    return np.stack([np.full(count, 1e3), azimuth], axis=1), time_s


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("kind", ["all around", "ahead", "at one place", "scanning", "sweeping"])
@pytest.mark.parametrize("interval_s", [0.1, 1.0, 1.7])
def test_a_radar_that_does_not_turn_is_never_taken_for_one_that_does(kind, timed, interval_s):
    revolutions, rng = Revolutions(), np.random.default_rng(4)
    for k in range(400):
        measurement, time_s = still(kind, rng)
        report = Detections(measurement, None, interval_s * time_s if timed else None)
        stamp_ns = START_NS + round(k * interval_s * 1e9)
        assert revolutions.split(stamp_ns, report) == [(stamp_ns, report)]
    assert revolutions.period_s == 0.0
    assert not +revolutions.anomalies


@pytest.mark.parametrize("ahead_s", [60.0, 12.0, 3.9])
def test_a_time_far_ahead_does_not_keep_a_revolution_from_being_found(ahead_s):
    radar = TurningRadar(sectors=8, plots=80)
    revolutions, reports = Revolutions(), radar.reports(6)
    time_s = reports[0].detections.time_s.copy()
    time_s[0] += ahead_s
    wrong = replace(reports[0].detections, time_s=time_s)
    revolutions.split(reports[0].stamp_ns, wrong)
    fed(revolutions, reports[1:])
    assert revolutions.period_s == pytest.approx(4.0, rel=0.01)


def test_a_late_detection_after_a_gap_does_not_make_the_gap_swept():
    radar = TurningRadar(sectors=8, plots=80)
    revolutions, reports = Revolutions(4.0, reset_threshold_s=12.0), radar.reports(12)
    fed(revolutions, reports[:40])
    # Four revolutions are lost, and one of their detections comes with what follows.
    sent, lost = reports[76], reports[45].detections.take(np.array([0]))
    late_s = lost.time_s + (reports[45].stamp_ns - sent.stamp_ns) / S
    joined = Detections(
        np.concatenate([sent.detections.measurement, lost.measurement]),
        None,
        np.concatenate([sent.detections.time_s, late_s]),
    )
    assert covered(revolutions.split(sent.stamp_ns, joined)).mean() < 1.3


def test_a_report_out_of_order_does_not_stop_the_search_for_a_revolution():
    radar = TurningRadar(sectors=8, plots=80)
    revolutions, reports = Revolutions(reset_threshold_s=12.0), radar.reports(6)
    swapped = [each for pair in zip(reports[1::2], reports[::2], strict=True) for each in pair]
    fed(revolutions, swapped)
    assert revolutions.period_s == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("length_s", [0.7, 0.75, 0.8])
def test_a_revolution_is_looked_for_in_just_enough_time(length_s):
    # The shortest revolution takes half a second, of which one and a half are needed.
    time_s = np.linspace(0.0, length_s, 40)
    azimuth = np.remainder(2.0 * np.pi * time_s / 0.5 + np.pi, 2.0 * np.pi) - np.pi
    revolutions, report = (
        Revolutions(),
        Detections(np.stack([np.full(40, 1e3), azimuth], axis=1), None, time_s),
    )
    revolutions.split(START_NS, report)
    assert revolutions.period_s == (pytest.approx(0.5, rel=0.01) if length_s >= 0.75 else 0.0)


def history_of(reports, rotation_s):
    """Return what has cut reports, and their pieces."""
    revolutions = Revolutions(rotation_s, reset_threshold_s=12.0)
    history = RevolutionHistory(revolutions)
    cut = [history.split(sent.stamp_ns, sent.detections, None) for sent in reports]
    return revolutions, history, cut


# Late are reports from before the revolution is found, from just then, and from after it.
@pytest.mark.parametrize("late", [2, 10, 30])
@pytest.mark.parametrize("rotation_s", [0.0, 4.0])
def test_a_late_report_and_those_after_it_become_what_they_would_have_been(rotation_s, late):
    on_time, _, wanted = history_of(REPORTS, rotation_s)
    revolutions, history, _ = history_of([*REPORTS[:late], *REPORTS[late + 1 :]], rotation_s)
    sent = REPORTS[late]
    assert history.count_later(sent.stamp_ns) == len(REPORTS) - late - 1
    found = history.insert(sent.stamp_ns, sent.detections, None)
    expected = [piece for pieces in wanted[late:] for piece in pieces]
    assert [stamp_ns for stamp_ns, _ in found.slices] == [stamp_ns for stamp_ns, _ in expected]
    for (_, piece), (_, other) in zip(found.slices, expected, strict=True):
        assert piece.coverage == other.coverage
        np.testing.assert_array_equal(piece.measurement, other.measurement)
    assert revolutions.period_s == on_time.period_s
    assert revolutions.nominal_period_s == on_time.nominal_period_s


def test_what_a_late_report_takes_the_place_of_is_named_by_its_first_stamps():
    _, history, cut = history_of([*REPORTS[:30], *REPORTS[31:]], 4.0)
    found = history.insert(REPORTS[30].stamp_ns, REPORTS[30].detections, None)
    assert found.stamps_ns == [stamp_ns for pieces in cut[30:] for stamp_ns, _ in pieces]


def test_a_report_that_comes_once_more_or_before_all_has_no_place():
    _, history, _ = history_of(REPORTS[1:], 4.0)
    assert history.count_later(REPORTS[5].stamp_ns) is Rejection.DUPLICATE
    assert history.count_later(REPORTS[0].stamp_ns) is Rejection.LATE
    history.forget_before(REPORTS[20].stamp_ns)
    assert history.count_later(REPORTS[20].stamp_ns - 1) is Rejection.LATE
    assert history.count_later(REPORTS[20].stamp_ns + 1) == len(REPORTS) - 21
