"""Hours of a turning radar: whatever happens to it, no detection's time ever changes."""

from dataclasses import dataclass

import numpy as np
import pytest
from antennas import START_NS
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.turns import Turns
from phd_jdtc_ros.core.types import FULL_TURN, Detections

GRID_S = 0.02
# Turns after a change of the antenna or its clock by which coverages must be right again.
SETTLED_TURNS = 4.0


@dataclass(frozen=True)
class Hour:
    """What happens in some time of a radar, seconds.

    `guess` is by what the given turn is too long; `jitter_s` moves stamps; of the detections a part
    `wrong` has any time; from `gap_s` no cloud comes, and without any plot in `quiet_s`; at
    `stop_s` the antenna stands; at `step_s` the radar's clock goes `step_by_s` ahead.
    """

    seed: int
    length_s: float = 3600.0
    rotation_s: float = 4.0016
    wind: float = 0.005
    guess: float = 0.0
    clouds_per_turn: float = 8.0
    plots_per_turn: float = 30.0
    jitter_s: float = 0.0
    wrong: float = 0.0
    gap_s: tuple = ()
    quiet_s: tuple = ()
    stop_s: tuple = ()
    step_s: float = np.inf
    step_by_s: float = 0.0

    def phase(self):
        """Return times and the antenna's azimuths then, which go on over the turns."""
        time_s = np.arange(0.0, self.length_s + 60.0, GRID_S)
        rate = -FULL_TURN / self.rotation_s * (1.0 + self.wind * np.sin(time_s / 40.0))
        rate[_inside(time_s, self.stop_s)] = 0.0
        return time_s, np.append(0.0, np.cumsum(rate)[:-1]) * GRID_S

    def clouds(self):
        """Yield stamps (ns) and detections, whose ranges are their numbers."""
        rng = np.random.default_rng(self.seed)
        count = rng.poisson(self.plots_per_turn * self.length_s / self.rotation_s)
        true_s = np.sort(rng.uniform(0.0, self.length_s, count))
        true_s = true_s[~_inside(true_s, self.quiet_s)]
        azimuth = np.interp(true_s, *self.phase()) + 1e-3 * rng.standard_normal(len(true_s))
        said_s = np.round(true_s * 128.0) / 128.0
        wrong = rng.random(len(said_s)) < self.wrong
        said_s[wrong] += rng.uniform(-2.0, 2.0, np.count_nonzero(wrong)) * self.rotation_s
        measurement = np.stack([1.0 + np.arange(len(said_s)), azimuth], axis=1)
        period_s = self.rotation_s / self.clouds_per_turn
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


def run(hour, turns):
    """Feed an hour; return how many of the sent were rejected, and coverages by stamp (s).

    Every detection that is taken must come out once, with the time that it came with.
    """
    rejected, covered = 0, []
    for stamp_ns, sent in hour.clouds():
        pieces = turns.split(stamp_ns, sent)
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
    near_s = SETTLED_TURNS * hour.rotation_s
    time_s = np.array([stamp_s for stamp_s, _ in covered])
    kept = time_s > since_s
    for edge_s in disturbed:
        kept &= np.abs(time_s - edge_s) > near_s
    for interval in (hour.quiet_s, hour.stop_s):
        kept &= ~_inside(time_s, interval)
    known = np.array([coverage.part_of_turn > 0.0 for _, coverage in covered])
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
        clouds_per_turn=draw(st.sampled_from([1.0, 3.7, 16.0])),
        plots_per_turn=draw(st.sampled_from([8.0, 30.0, 120.0])),
        jitter_s=draw(st.sampled_from([0.0, 0.02])) * rotation_s,
        wrong=draw(st.sampled_from([0.0, 0.02])),
        gap_s=some(30.0 * rotation_s),
        quiet_s=some(30.0 * rotation_s),
        stop_s=some(20.0 * rotation_s),
        step_s=draw(st.sampled_from([np.inf, 0.45])) * length_s,
        step_by_s=draw(st.sampled_from([0.7, 30.0])),
    )


def turns_of(hour):
    given_s = round(hour.rotation_s * (1.0 + hour.guess), 3)
    return Turns(given_s, reset_threshold_s=3.0 * hour.rotation_s)


# An antenna that stands for so long that the turn is looked for again.
STOOD = Hour(0, 302.4, 1.008, guess=-0.03, clouds_per_turn=3.7, stop_s=(151.2, 171.36))

# A line that followed an antenna until it stood, and was taken for a turn of hours.
STOPPED = Hour(
    *(327236, 3600.0, 12.0),
    guess=-1.0,
    clouds_per_turn=16.0,
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
    rejected, covered = run(hour, turns_of(hour))
    assert rejected == 0
    apart, known = off(hour, covered, 20.0 * hour.rotation_s)
    # Behind detections with any time a line may lie off for a while, but not by a turn.
    assert np.mean(apart > 0.25) < 0.02
    assert known > 0.9


@pytest.mark.parametrize("guess", [0.03, -0.03, -1.0])
def test_turns_of_an_approach_radar_are_cut_where_the_antenna_was(guess):
    length_s = 900.0 if guess > 0.0 else 600.0
    hour = Hour(seed=1, length_s=length_s, guess=guess, clouds_per_turn=16.0, jitter_s=0.05)
    turns = turns_of(hour)
    rejected, covered = run(hour, turns)
    assert rejected == 0
    apart, known = off(hour, covered, 10.0 * hour.rotation_s)
    assert apart.max() < np.radians(3.0)
    assert known == 1.0
    assert turns.period_s == pytest.approx(hour.rotation_s, rel=0.01)


def test_a_clock_that_goes_back_loses_the_repeated_times_and_no_more():
    hour = Hour(seed=2, length_s=600.0, step_s=300.0, step_by_s=-1.5, clouds_per_turn=16.0)
    rejected, covered = run(hour, turns_of(hour))
    assert 0 < rejected < 1.6 / hour.rotation_s * 2.0 * hour.plots_per_turn
    apart, _ = off(hour, covered, 40.0)
    assert np.mean(apart > 0.25) == 0.0
