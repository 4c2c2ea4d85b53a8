"""Revolutions by sector, and hours of a turning radar: no time of a detection ever changes."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
from antennas import (
    NONE,
    START_NS,
    S,
    TurningRadar,
    covered,
    degrees_off,
    emptied,
    fed,
    revolutions_of,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.sectors import coverage_of, slices_per_revolution
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN_COVERAGE, Detections

SLICES = slices_per_revolution(4.0)
GRID_S = 0.02
# Revolutions after a change of the antenna or its clock by which coverages must be right again.
SETTLED_REVOLUTIONS = 4.0


@dataclass(frozen=True)
class Hour:
    """What happens in some time of a radar, seconds.

    `guess` is by what the given revolution is too long; `jitter_s` moves stamps; of the detections
    a part `wrong` has any time; from `gap_s` no cloud comes, and without any plot in `quiet_s`; at
    `stop_s` the antenna stands; at `step_s` the radar's clock goes `step_by_s` ahead.
    """

    seed: int
    length_s: float = 3600.0
    rotation_s: float = 4.0016
    wind: float = 0.005
    guess: float = 0.0
    clouds_per_revolution: float = 8.0
    plots_per_revolution: float = 30.0
    jitter_s: float = 0.0
    wrong: float = 0.0
    gap_s: tuple = ()
    quiet_s: tuple = ()
    stop_s: tuple = ()
    step_s: float = np.inf
    step_by_s: float = 0.0

    def phase(self):
        """Return times and the antenna's azimuths then, which go on over the revolutions."""
        time_s = np.arange(0.0, self.length_s + 60.0, GRID_S)
        rate = -FULL_TURN / self.rotation_s * (1.0 + self.wind * np.sin(time_s / 40.0))
        rate[_inside(time_s, self.stop_s)] = 0.0
        return time_s, np.append(0.0, np.cumsum(rate)[:-1]) * GRID_S

    def clouds(self):
        """Yield stamps (ns) and detections, whose ranges are their numbers."""
        rng = np.random.default_rng(self.seed)
        count = rng.poisson(self.plots_per_revolution * self.length_s / self.rotation_s)
        true_s = np.sort(rng.uniform(0.0, self.length_s, count))
        true_s = true_s[~_inside(true_s, self.quiet_s)]
        azimuth = np.interp(true_s, *self.phase()) + 1e-3 * rng.standard_normal(len(true_s))
        said_s = np.round(true_s * 128.0) / 128.0
        wrong = rng.random(len(said_s)) < self.wrong
        said_s[wrong] += rng.uniform(-2.0, 2.0, np.count_nonzero(wrong)) * self.rotation_s
        measurement = np.stack([1.0 + np.arange(len(said_s)), azimuth], axis=1)
        period_s = self.rotation_s / self.clouds_per_revolution
        edges = np.arange(0.0, self.length_s, period_s)
        cloud = np.searchsorted(edges, true_s, side="right") - 1
        for k, begin_s in enumerate(edges):
            if _inside(begin_s, self.gap_s):
                continue
            rows = np.flatnonzero(cloud == k)
            ahead_s = self.step_by_s if begin_s >= self.step_s else 0.0
            stamp_s = begin_s + period_s + self.jitter_s * rng.uniform() + ahead_s
            time_s = said_s[rows] + ahead_s - stamp_s
            yield START_NS + round(stamp_s * 1e9), Detections(measurement[rows], None, time_s)


def _inside(time_s, interval):
    if not interval:
        return np.zeros(np.shape(time_s), dtype=bool)
    return (np.asarray(time_s) >= interval[0]) & (np.asarray(time_s) < interval[1])


def run(hour, revolutions):
    """Feed an hour; return how many of the sent were rejected, and coverages by stamp (s).

    Every detection that is taken must come out once, with the time that it came with.
    """
    rejected, covered = 0, []
    for stamp_ns, sent in hour.clouds():
        pieces = revolutions.split(stamp_ns, sent)
        if isinstance(pieces, Rejection):
            rejected += len(sent)
            continue
        came = np.concatenate([piece.measurement[:, 0] for _, piece in pieces])
        order = np.argsort(came)
        np.testing.assert_array_equal(came[order], sent.measurement[:, 0])
        absolute_ns = np.concatenate(
            [own_ns - stamp_ns + piece.time_s * 1e9 for own_ns, piece in pieces]
        )
        np.testing.assert_allclose(absolute_ns[order], sent.time_s * 1e9, atol=2.0, rtol=0.0)
        covered += [
            ((own_ns - START_NS) * 1e-9, piece.coverage)
            for own_ns, piece in pieces
            if piece.coverage is not None
        ]
    return rejected, covered


def off(hour, covered, since_s):
    """Return how far coverages' middles are from the antenna, radians, and the known share.

    Of stamps in the first interval after `since_s` in which the antenna turns evenly.
    """
    disturbed = [each for pair in (hour.gap_s, hour.quiet_s, hour.stop_s) for each in pair]
    disturbed += [hour.step_s] if np.isfinite(hour.step_s) else []
    near_s = SETTLED_REVOLUTIONS * hour.rotation_s
    time_s = np.array([stamp_s for stamp_s, _ in covered])
    kept = time_s > since_s
    for edge_s in disturbed:
        kept &= np.abs(time_s - edge_s) > near_s
    for interval in (hour.quiet_s, hour.stop_s):
        kept &= ~_inside(time_s, interval)
    known = np.array([coverage.part_of_revolution > 0.0 for _, coverage in covered])
    rows = np.flatnonzero(kept & known)
    middle = np.array([covered[k][1].start + 0.5 * covered[k][1].width for k in rows])
    ahead_s = np.where(time_s[rows] > hour.step_s, hour.step_by_s, 0.0)
    true = np.interp(time_s[rows] - ahead_s, *hour.phase())
    apart = np.abs(np.remainder(middle - true + np.pi, FULL_TURN) - np.pi)
    return apart, len(rows) / np.count_nonzero(kept)


@st.composite
def hours(draw):
    rotation_s = draw(st.sampled_from([1.008, 4.0016, 12.0]))
    length_s = 300.0 * rotation_s

    def some(longest_s):
        if not draw(st.booleans()):
            return ()
        begin_s = draw(st.floats(0.1, 0.8)) * length_s
        return begin_s, begin_s + draw(st.floats(0.5, 1.0)) * longest_s

    return Hour(
        seed=draw(st.integers(0, 10**6)),
        length_s=length_s,
        rotation_s=rotation_s,
        guess=draw(st.sampled_from([-0.03, 0.0, 0.03, -1.0])),
        clouds_per_revolution=draw(st.sampled_from([1.0, 3.7, 16.0])),
        plots_per_revolution=draw(st.sampled_from([8.0, 30.0, 120.0])),
        jitter_s=draw(st.sampled_from([0.0, 0.02])) * rotation_s,
        wrong=draw(st.sampled_from([0.0, 0.02])),
        gap_s=some(30.0 * rotation_s),
        quiet_s=some(30.0 * rotation_s),
        stop_s=some(20.0 * rotation_s),
        step_s=draw(st.sampled_from([np.inf, 0.45])) * length_s,
        step_by_s=draw(st.sampled_from([0.7, 30.0])),
    )


def revolutions_of_hour(hour):
    given_s = round(hour.rotation_s * (1.0 + hour.guess), 3)
    return Revolutions(given_s, reset_threshold_s=3.0 * hour.rotation_s)


# An antenna that stands for so long that the revolution is looked for again.
STOOD = Hour(0, 302.4, 1.008, guess=-0.03, clouds_per_revolution=3.7, stop_s=(151.2, 171.36))


# A line that followed an antenna until it stood, and was taken for a revolution of hours.
STOPPED = Hour(
    *(327236, 3600.0, 12.0),
    guess=-1.0,
    clouds_per_revolution=16.0,
    jitter_s=0.24,
    wrong=0.02,
    gap_s=(2415.1311101022347, 2761.431018026897),
    quiet_s=(2048.8429939303683, 2325.4523246023386),
    stop_s=(1274.2499963562377, 1465.4766987067567),
)


@settings(deadline=None, max_examples=6)
@example(hour=STOOD)
@example(hour=STOPPED)
@given(hour=hours())
def test_times_never_change_and_coverages_follow_the_antenna(hour):
    rejected, covered = run(hour, revolutions_of_hour(hour))
    assert rejected == 0
    apart, known = off(hour, covered, 20.0 * hour.rotation_s)
    # Behind detections with any time a line may lie off for a while, but not by a revolution.
    assert np.mean(apart > 0.25) < 0.02
    assert known > 0.9


@pytest.mark.parametrize("guess", [0.03, -0.03, -1.0])
def test_revolutions_of_an_approach_radar_are_cut_where_the_antenna_was(guess):
    length_s = 900.0 if guess > 0.0 else 600.0
    hour = Hour(seed=1, length_s=length_s, guess=guess, clouds_per_revolution=16.0, jitter_s=0.05)
    revolutions = revolutions_of_hour(hour)
    rejected, covered = run(hour, revolutions)
    assert rejected == 0
    apart, known = off(hour, covered, 10.0 * hour.rotation_s)
    assert apart.max() < np.radians(3.0)
    assert known == 1.0
    assert revolutions.period_s == pytest.approx(hour.rotation_s, rel=0.01)


def test_a_clock_that_goes_back_loses_the_repeated_times_and_no_more():
    hour = Hour(seed=2, length_s=600.0, step_s=300.0, step_by_s=-1.5, clouds_per_revolution=16.0)
    rejected, covered = run(hour, revolutions_of_hour(hour))
    assert 0 < rejected < 1.6 / hour.rotation_s * 2.0 * hour.plots_per_revolution
    apart, _ = off(hour, covered, 40.0)
    assert np.mean(apart > 0.25) == 0.0


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("sectors", [4, 16])
def test_a_sector_covers_the_azimuths_of_its_number(sectors, timed, compass):
    # Numbers count in the direction of azimuths, from azimuth zero.
    radar = TurningRadar(
        sectors=sectors, timed=timed, clockwise=compass, cut=-0.5 * np.pi if compass else 0.0
    )
    revolutions = revolutions_of(radar, compass=compass)
    reports = radar.reports(4)
    for k, (sent, pieces) in enumerate(zip(reports, fed(revolutions, reports, True), strict=True)):
        assert degrees_off(sent, pieces) < 1.5
        if not timed:
            ((stamp_ns, piece),) = pieces
            assert stamp_ns == sent.stamp_ns
            assert piece.coverage == coverage_of(sent.sector, sectors, compass)
        elif k >= radar.per_revolution:
            assert len(pieces) == max(SLICES // sectors, 1)
            longest = max(np.abs(piece.time_s).max(initial=0.0) for _, piece in pieces)
            assert longest < 0.5 * 4.0 / SLICES + 0.03
    assert not +revolutions.anomalies


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
        revolutions = revolutions_of(radar, compass=compass, azimuth_bias=configured)
        pairs = zip(reports, fed(revolutions, reports, True), strict=True)
        off[configured] = max(degrees_off(sent, pieces) for sent, pieces in pairs)
    assert off[bias] < 1.5
    assert off[0.0] > 5.0


@pytest.mark.parametrize("timed", [False, True])
def test_empty_sectors_go_on_with_numbers_or_the_antenna(timed):
    radar = TurningRadar(sectors=16, timed=timed, cut=0.0)
    reports = [s if k % 3 else emptied(s) for k, s in enumerate(radar.reports(4))]
    numbers = [sent.sector if len(sent.detections) else None for sent in reports]
    revolutions = revolutions_of(radar)
    for k, sent in enumerate(reports):
        pieces = revolutions.split(sent.stamp_ns, sent.detections, numbers[k])
        if k > 2:
            assert degrees_off(sent, pieces) < 1.5
    assert not +revolutions.anomalies
    radar = TurningRadar(sectors=16, timed=timed, plots=150)
    reports = radar.reports(6)
    revolutions = revolutions_of(radar)
    fed(revolutions, reports[:48])
    for sent in reports[48:]:
        pieces = revolutions.split(sent.stamp_ns, emptied(sent).detections)
        assert degrees_off(sent, pieces) < 4.0
    assert not +revolutions.anomalies


def test_the_first_and_empty_sectors_cover_nothing():
    revolutions = Revolutions(4.0, 16)
    for k in range(20):
        ((stamp_ns, piece),) = revolutions.split(START_NS + k * S // 4, NONE)
        assert (stamp_ns, piece.coverage) == (START_NS + k * S // 4, UNKNOWN_COVERAGE)
    radar = TurningRadar(sectors=8, timed=False, plots=150)
    sent = radar.reports(1)[0]
    ((stamp_ns, piece),) = revolutions_of(radar).split(sent.stamp_ns, sent.detections)
    assert (stamp_ns, piece.coverage) == (sent.stamp_ns, UNKNOWN_COVERAGE)
    np.testing.assert_array_equal(piece.measurement, sent.detections.measurement)


@pytest.mark.parametrize("numbers", [False, True])
@pytest.mark.parametrize("timed", [False, True])
def test_a_repeated_sector_is_used_and_covers_nothing(timed, numbers):
    radar = TurningRadar(sectors=16, timed=timed, cut=0.0, plots=150)
    revolutions, reports = revolutions_of(radar), radar.reports(4)
    fed(revolutions, reports[:37], numbers)
    again = reports[36]
    stamp_ns = again.stamp_ns + 20_000_000
    sector = again.sector if numbers else None
    ((_, piece),) = revolutions.split(stamp_ns, again.detections, sector)
    assert piece.coverage == UNKNOWN_COVERAGE
    assert len(piece) == len(again.detections)
    assert +revolutions.anomalies == {"sectors_repeated": 1}
    for sent, pieces in zip(reports[37:], fed(revolutions, reports[37:], numbers), strict=True):
        assert degrees_off(sent, pieces) < 5.0


@pytest.mark.parametrize("timed", [False, True])
def test_overlapping_sectors_share_the_revolution_between_them(timed):
    radar = TurningRadar(sectors=16, timed=timed, plots=300)
    reports = radar.reports(6)
    revolutions, total = revolutions_of(radar), []
    for before, sent in itertools.pairwise(reports):
        # The last third of a report's detections comes with the next one.
        count = len(before.detections)
        late = before.detections.take(np.arange(count * 2 // 3, count))
        joined = joined_at(sent, late, before)
        pieces = revolutions.split(sent.stamp_ns, joined)
        total.append(covered(pieces))
    settled = np.sum(total[32:64], axis=0) / 2.0
    assert abs(settled.mean() - 1.0) < 0.15
    assert revolutions.anomalies["antenna_unclear"] == 0


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
    revolutions = revolutions_of(radar)
    reports = radar.reports(5)
    for k, sent in enumerate(reports):
        pieces = revolutions.split(sent.stamp_ns, sent.detections, (sent.sector + 8) % 16)
        if k >= 32:
            assert degrees_off(sent, pieces) < 4.0
    assert revolutions.anomalies["sector_numbers_wrong"] > 60


@pytest.mark.parametrize("sectors", [0, 16])
def test_detections_in_a_part_of_the_revolution_alone_are_enough(sectors):
    radar = TurningRadar(sectors=sectors, plots=40, seen=(0.4, 0.55))
    revolutions = revolutions_of(radar)
    reports = radar.reports(6)
    for sent, pieces in list(zip(reports, fed(revolutions, reports), strict=True))[
        2 * radar.per_revolution :
    ]:
        assert degrees_off(sent, pieces) < 16.0
        inside = sum(len(piece) for _, piece in pieces)
        assert inside == len(sent.detections)
    assert not +revolutions.anomalies


def test_a_late_sector_without_times_keeps_its_stamp_for_the_grouper():
    radar = TurningRadar(sectors=16, timed=False, cut=0.0)
    revolutions, reports = revolutions_of(radar), radar.reports(2)
    fed(revolutions, reports[:10], True)
    ((stamp_ns, piece),) = revolutions.split(reports[8].stamp_ns, reports[8].detections, 8)
    assert (stamp_ns, piece.coverage) == (reports[8].stamp_ns, coverage_of(8, 16, False))
    ((_, piece),) = revolutions.split(reports[7].stamp_ns, reports[7].detections)
    assert piece.coverage == UNKNOWN_COVERAGE
