"""Turns that come sector by sector."""

import itertools

import numpy as np
import pytest
from antennas import NONE, START_NS, S, TurningRadar, covered, degrees_off, emptied, fed, turns_of

from phd_jdtc_ros.core.intake.sectors import coverage_of
from phd_jdtc_ros.core.intake.slices import SLICES
from phd_jdtc_ros.core.intake.turns import Turns
from phd_jdtc_ros.core.types import UNKNOWN_COVERAGE, Detections


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("sectors", [4, 16])
def test_a_sector_covers_the_azimuths_of_its_number(sectors, timed, compass):
    # Numbers count in the direction of azimuths, from azimuth zero.
    radar = TurningRadar(
        sectors=sectors, timed=timed, clockwise=compass, cut=-0.5 * np.pi if compass else 0.0
    )
    turns = turns_of(radar, compass=compass)
    reports = radar.reports(4)
    for k, (sent, pieces) in enumerate(zip(reports, fed(turns, reports, True), strict=True)):
        assert degrees_off(sent, pieces) < 1.5
        if not timed:
            ((stamp_ns, piece),) = pieces
            assert stamp_ns == sent.stamp_ns
            assert piece.coverage == coverage_of(sent.sector, sectors, compass)
        elif k >= radar.per_turn:
            assert len(pieces) == max(SLICES // sectors, 1)
            longest = max(np.abs(piece.time_s).max(initial=0.0) for _, piece in pieces)
            assert longest < 0.5 * 4.0 / SLICES + 0.03
    assert not +turns.anomalies


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("timed", [False, True])
def test_a_sector_of_a_misaligned_antenna_covers_where_it_truly_was(timed, compass):
    # The antenna, and its sectors, are 3 degrees clockwise of the reported azimuth.
    bias = np.radians(3.0)
    cut = -0.5 * np.pi + bias if compass else -bias
    radar = TurningRadar(sectors=16, timed=timed, clockwise=compass, cut=cut)
    reports = radar.reports(4)
    off = {}
    for configured in (0.0, bias):
        turns = turns_of(radar, compass=compass, azimuth_bias=configured)
        pairs = zip(reports, fed(turns, reports, True), strict=True)
        off[configured] = max(degrees_off(sent, pieces) for sent, pieces in pairs)
    assert off[bias] < 1.5
    assert off[0.0] > 5.0


@pytest.mark.parametrize("timed", [False, True])
def test_empty_sectors_go_on_with_numbers_or_the_antenna(timed):
    radar = TurningRadar(sectors=16, timed=timed, cut=0.0)
    reports = [s if k % 3 else emptied(s) for k, s in enumerate(radar.reports(4))]
    numbers = [sent.sector if len(sent.detections) else None for sent in reports]
    turns = turns_of(radar)
    for k, sent in enumerate(reports):
        pieces = turns.split(sent.stamp_ns, sent.detections, numbers[k])
        if k > 2:
            assert degrees_off(sent, pieces) < 1.5
    assert not +turns.anomalies
    radar = TurningRadar(sectors=16, timed=timed, plots=150)
    reports = radar.reports(6)
    turns = turns_of(radar)
    fed(turns, reports[:48])
    for sent in reports[48:]:
        pieces = turns.split(sent.stamp_ns, emptied(sent).detections)
        assert degrees_off(sent, pieces) < 4.0
    assert not +turns.anomalies


def test_the_first_and_empty_sectors_cover_nothing():
    turns = Turns(4.0, 16)
    for k in range(20):
        ((stamp_ns, piece),) = turns.split(START_NS + k * S // 4, NONE)
        assert (stamp_ns, piece.coverage) == (START_NS + k * S // 4, UNKNOWN_COVERAGE)
    radar = TurningRadar(sectors=8, timed=False, plots=150)
    sent = radar.reports(1)[0]
    ((stamp_ns, piece),) = turns_of(radar).split(sent.stamp_ns, sent.detections)
    assert (stamp_ns, piece.coverage) == (sent.stamp_ns, UNKNOWN_COVERAGE)
    np.testing.assert_array_equal(piece.measurement, sent.detections.measurement)


@pytest.mark.parametrize("numbers", [False, True])
@pytest.mark.parametrize("timed", [False, True])
def test_a_repeated_sector_is_used_and_covers_nothing(timed, numbers):
    radar = TurningRadar(sectors=16, timed=timed, cut=0.0, plots=150)
    turns, reports = turns_of(radar), radar.reports(4)
    fed(turns, reports[:37], numbers)
    again = reports[36]
    stamp_ns = again.stamp_ns + 20_000_000
    sector = again.sector if numbers else None
    ((_, piece),) = turns.split(stamp_ns, again.detections, sector)
    assert piece.coverage == UNKNOWN_COVERAGE
    assert len(piece) == len(again.detections)
    assert +turns.anomalies == {"sectors_repeated": 1}
    for sent, pieces in zip(reports[37:], fed(turns, reports[37:], numbers), strict=True):
        assert degrees_off(sent, pieces) < 5.0


@pytest.mark.parametrize("timed", [False, True])
def test_overlapping_sectors_share_the_turn_between_them(timed):
    radar = TurningRadar(sectors=16, timed=timed, plots=300)
    reports = radar.reports(6)
    turns, total = turns_of(radar), []
    for before, sent in itertools.pairwise(reports):
        # The last third of a report's detections comes with the next one.
        count = len(before.detections)
        late = before.detections.take(np.arange(count * 2 // 3, count))
        joined = joined_at(sent, late, before)
        pieces = turns.split(sent.stamp_ns, joined)
        total.append(covered(pieces))
    settled = np.sum(total[32:64], axis=0) / 2.0
    assert abs(settled.mean() - 1.0) < 0.15
    assert turns.anomalies["antenna_unclear"] == 0


def joined_at(sent, late, before):
    """Return a report's detections with late ones of the report before."""
    first = len(sent.detections) * 2 // 3
    own = sent.detections.take(np.arange(first))
    time_s = None
    if own.time_s is not None:
        earlier = late.time_s + (before.stamp_ns - sent.stamp_ns) / S
        time_s = np.concatenate([earlier, own.time_s])
    return Detections(np.concatenate([late.measurement, own.measurement]), None, time_s)


def test_sector_numbers_that_count_from_one_are_noticed_and_not_believed():
    radar = TurningRadar(sectors=16, timed=False, cut=0.0, plots=300)
    turns = turns_of(radar)
    reports = radar.reports(5)
    for k, sent in enumerate(reports):
        pieces = turns.split(sent.stamp_ns, sent.detections, (sent.sector + 8) % 16)
        if k >= 32:
            assert degrees_off(sent, pieces) < 4.0
    assert turns.anomalies["sector_numbers_wrong"] > 60


@pytest.mark.parametrize("sectors", [0, 16])
def test_detections_in_a_part_of_the_turn_alone_are_enough(sectors):
    radar = TurningRadar(sectors=sectors, plots=40, seen=(0.4, 0.55))
    turns = turns_of(radar)
    reports = radar.reports(6)
    for sent, pieces in list(zip(reports, fed(turns, reports), strict=True))[2 * radar.per_turn :]:
        assert degrees_off(sent, pieces) < 16.0
        inside = sum(len(piece) for _, piece in pieces)
        assert inside == len(sent.detections)
    assert not +turns.anomalies


def test_a_late_sector_without_times_keeps_its_stamp_for_the_grouper():
    radar = TurningRadar(sectors=16, timed=False, cut=0.0)
    turns, reports = turns_of(radar), radar.reports(2)
    fed(turns, reports[:10], True)
    ((stamp_ns, piece),) = turns.split(reports[8].stamp_ns, reports[8].detections, 8)
    assert (stamp_ns, piece.coverage) == (reports[8].stamp_ns, coverage_of(8, 16, False))
    ((_, piece),) = turns.split(reports[7].stamp_ns, reports[7].detections)
    assert piece.coverage == UNKNOWN_COVERAGE
