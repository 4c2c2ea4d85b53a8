"""Detections of an antenna that turns, as reports of whole revolutions or of sectors."""

from dataclasses import dataclass, replace

import numpy as np

from phd_jdtc_ros.core.intake.revolutions import Revolutions
from phd_jdtc_ros.core.sensors.visibility import sector_probability
from phd_jdtc_ros.core.types import FULL_TURN, Detections

S = 1_000_000_000
START_NS = 1_700_000_000_000_000_000
# No azimuth is the edge of a sector.
GRID = np.linspace(-np.pi, np.pi, 720, endpoint=False) + 1e-4
NONE = Detections(np.zeros((0, 2)), None)
NONE_TIMED = Detections(np.zeros((0, 2)), None, np.zeros(0))


@dataclass(frozen=True)
class Sent:
    """A report as a radar sends it, and the azimuths that the antenna passed for it.

    `passed` marks them among the azimuths of `GRID`.
    """

    stamp_ns: int
    detections: Detections
    sector: int
    passed: np.ndarray


@dataclass(frozen=True)
class TurningRadar:
    """An antenna and how it reports.

    `stamp_at` is the place of the stamp in what a report covers, from 0 to 1; `cut` is the phase
    at which reports begin; `seen` is the part of the revolution in which there is anything to
    detect.
    """

    rotation_s: float = 4.0
    sectors: int = 0
    clockwise: bool = False
    timed: bool = True
    stamp_at: float = 1.0
    cut: float = 0.3
    plots: int = 80
    noise: float = 0.002
    time_step_s: float = 1.0 / 128.0
    seen: tuple = (0.0, 1.0)

    @property
    def per_revolution(self):
        return max(self.sectors, 1)

    def reports(self, revolutions, seed=0, lengths=None):
        """Return the reports of some revolutions, of the given lengths in seconds."""
        rng = np.random.default_rng(seed)
        lengths = [self.rotation_s] * revolutions if lengths is None else lengths
        begins = np.concatenate([[0.0], np.cumsum(lengths)])
        sent = []
        for revolution, length in enumerate(lengths):
            share = rng.uniform(*self.seen, rng.poisson(self.plots))
            for part in range(self.per_revolution):
                inside = np.sort(share[(share * self.per_revolution).astype(int) == part])
                sent.append(self._report(revolution, part, begins[revolution], length, inside, rng))
        return sent

    def _report(self, revolution, part, begin_s, length_s, share, rng):
        time_s = begin_s + length_s * share
        if self.time_step_s:
            time_s = np.round(time_s / self.time_step_s) * self.time_step_s
        phase = self.cut + FULL_TURN * share + self.noise * rng.standard_normal(len(share))
        stamp_s = begin_s + length_s * (part + self.stamp_at) / self.per_revolution
        distance = 1000.0 + 100.0 * np.arange(len(share)) + revolution
        measurement = np.stack([distance, self.azimuth(phase)], axis=1)
        first = self.cut + FULL_TURN * part / self.per_revolution
        return Sent(
            START_NS + round(stamp_s * 1e9),
            Detections(measurement, None, time_s - stamp_s if self.timed else None),
            part,
            np.mod(self.phase(GRID) - first, FULL_TURN) < FULL_TURN / self.per_revolution,
        )

    def azimuth(self, phase):
        """Return the azimuths of phases, in [-pi, pi)."""
        return np.mod((-phase if self.clockwise else phase) + np.pi, FULL_TURN) - np.pi

    def phase(self, azimuth):
        return -azimuth if self.clockwise else azimuth


def covered(pieces):
    """Return how often each azimuth of `GRID` is covered by pieces."""
    times = np.zeros(len(GRID))
    for _, piece in pieces:
        times += 1.0 if piece.coverage is None else sector_probability(GRID, piece.coverage)
    return times


def degrees_off(sent, pieces):
    """Return how many degrees are covered too often or too rarely by a report's pieces."""
    return float(np.abs(covered(pieces) - sent.passed).sum()) * 360.0 / len(GRID)


def widest_gap(reports, per_revolution):
    """Return the largest angle between successive azimuths in any revolution, degrees."""
    revolutions = [
        reports[first : first + per_revolution] for first in range(0, len(reports), per_revolution)
    ]
    azimuths = [
        np.concatenate([sent.detections.measurement[:, 1] for sent in revolution])
        for revolution in revolutions
    ]
    around = [
        np.sort(np.append(revolution, revolution.min() + FULL_TURN)) for revolution in azimuths
    ]
    return float(np.degrees(max(np.diff(revolution).max() for revolution in around)))


def revolutions_of(radar, **changes):
    given = {"compass": False, "reset_threshold_s": 3.0 * radar.rotation_s, **changes}
    return Revolutions(radar.rotation_s, radar.sectors, **given)


def fed(revolutions, reports, numbers=False):
    return [
        revolutions.split(sent.stamp_ns, sent.detections, sent.sector if numbers else None)
        for sent in reports
    ]


def emptied(sent):
    nothing = NONE if sent.detections.time_s is None else NONE_TIMED
    return replace(sent, detections=nothing)


def absolute(stamp_ns, detections):
    """Return range and absolute time (ns) of detections, in the order of ranges."""
    time_s = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    rows = [
        (distance, stamp_ns - START_NS + round(own * 1e9))
        for distance, own in zip(detections.measurement[:, 0], time_s, strict=True)
    ]
    return sorted(rows)
