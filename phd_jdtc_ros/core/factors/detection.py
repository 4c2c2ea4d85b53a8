"""Learned ratio of a sensor's detection probability to the configured one, by place.

A miss has two explanations: the sensor did not detect the target, or the target was no longer
there. Between two detections of a target only the first explanation is possible. Therefore a trial,
a look with a detection or a miss, counts when the target is detected again, by any sensor. A
target's first detection never counts, because there would be no target without it. Its last
detection and later misses do not count either: when a target disappears, or was false, its open
trials disappear too.

Changes raise an alarm, for fewer detections of the sensor as a whole and for a blind sector. Each
is a cumulative sum (CUSUM; E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954) of the
log likelihood ratios of the changed and the learned value, kept at zero or above. For a sector, the
learned value is the one at the time when the sum was last zero, because later values follow the
change. After an alarm it is the present value, so that the alarm ends once this has followed the
change. For the sensor as a whole it is always the present value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from ..arrays import (
    TINY,
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnly,
    contains,
    frozen,
    zeros_field,
)
from ..association.evidence import KNOWN_EXISTENCE
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import MAX_INDEX, floats, integers, nested
from .factor import Factor, Look
from .prior import MOST_EVIDENCE, RAISED, RatioPrior
from .trials import Alarm, FactorPriors, LearnedFactors, ReportTrials, Trials, TrialSums

# Number of cells in range, in equal parts of the largest range, and in azimuth.
RANGES, AZIMUTHS = 8, 8
CELLS = RANGES * AZIMUTHS
# Weight of the configured probability, in expected detections, so that the first looks alone do not
# determine the factor.
PRIOR_WEIGHT = 4.0
# Priors of the sensor's probability relative to the configured one, and of a cell's relative to the
# sensor's. That of cells is stricter, because some of many cells differ by chance, and a
# probability that is a little too high doubles the evidence of a miss.
SENSOR_PRIOR = RatioPrior(0.5, 0.02, 0.5)
CELL_PRIOR = RatioPrior(0.9, 0.01, 0.5)
# Memory, in expected detections: of the sensor's mean, and of each cell.
MEMORY = 1000.0
# Bounds of the learned probability: at 1, a target would be deleted at its first miss.
LEAST_PROBABILITY, MOST_PROBABILITY = 0.02, 0.995
# Largest number of remembered detections accepted in a snapshot; a report may add many at once.
MAX_REMEMBERED = 1e7
# Changes to detect: ratios of the detection probability to the learned one. In a blind sector it is
# `BLIND`, and in any sector of a sensor that detects less as a whole `SHARED`.
FEWER = 0.7
BLIND, SHARED = 0.15, 0.6
# Largest learned factor accepted in a snapshot.
MOST_FACTOR = 1e4
# Number of expected detections, of the sensor and of a sector, after which detections are compared
# with the learned value.
SETTLED, SETTLED_SECTOR = 50.0, 20.0


def _of_both(of_sensor: float, of_sector: float) -> FloatArray:
    """Return the value of the sensor as a whole, and then that of each sector, (1 + A,)."""
    return np.array([of_sensor, *[of_sector] * AZIMUTHS])


CHANGES = frozen(
    Alarm(
        RAISED,
        MOST_EVIDENCE,
        changed=_of_both(FEWER, BLIND),
        unchanged=_of_both(1.0, SHARED),
        known=_of_both(SETTLED, SETTLED_SECTOR),
    )
)
# Largest number of expected detections of one trial: a small learned factor can bring the
# configured probability above 1.
MOST_EXPECTED = 100.0


@dataclass(frozen=True, eq=False)
class OpenTrials(ReadOnly):
    """Open trials, arrays of shape (E,)."""

    # Label of the target.
    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = zeros_field(0, dtype=np.int64)
    # As in `ReportTrials`.
    cell: Annotated[IntArray, integers("E", 0, below="K")] = zeros_field(0, dtype=np.int64)
    expected: Annotated[FloatArray, floats("E", 0.0, MOST_EXPECTED)] = zeros_field(0)
    detected: Annotated[FloatArray, floats("E", 0.0, 1.0)] = zeros_field(0)
    # Share of each trial that is open.
    open_share: Annotated[FloatArray, floats("E", 0.0, 1.0, key="still")] = zeros_field(0)

    def __len__(self) -> int:
        return len(self.label)

    def take(self, rows: IntArray | BoolArray) -> OpenTrials:
        """Return the trials of some rows, by their indices or a mask."""
        return OpenTrials(
            self.label[rows],
            self.cell[rows],
            self.expected[rows],
            self.detected[rows],
            self.open_share[rows],
        )

    def of(self, labels: IntArray) -> OpenTrials:
        """Return the trials for the targets of ascending labels."""
        return self.take(contains(labels, self.label))

    def after(self, trials: ReportTrials, cells: int) -> tuple[OpenTrials, TrialSums]:
        """Return the open trials after a report, and sums over those that count now.

        `cells` is the number of all sensors' cells, K. If a target is detected with probability d,
        given that it exists, the share d of its open trials counts, times its existence
        probability. The share 1 - d stays open, and so does the report's own trial for it.
        """
        from .loops import count_trials

        before = Trials(self.label, self.cell, self.expected, self.detected, self.open_share)
        own = frozen(ReportTrials(*trials))
        # Trials with a smaller open share are dropped.
        least_open = 1e-3
        trials_left, counted = count_trials(least_open, cells, before, own)
        return self.changed(**trials_left._asdict()), frozen(counted)


@dataclass(frozen=True, eq=False)
class Detection(Factor):
    """Expected and actual detections of known targets, as remembered by cell.

    The true probability is the configured one times a factor. h detections where e were expected
    show the factor (k + h) / (k + e), with k = `PRIOR_WEIGHT`: for a constant probability this is
    the mean of a Beta distribution, scaled. Its log has the precision n p / (1 - p) after n looks
    at targets that are detected with probability p; see `RatioPrior`. A cell's factor is learned in
    the same way relative to the sensor's. All counts fade with exp(-e / MEMORY).
    """

    NAME: ClassVar[str] = "detection_factor"
    SIZES: ClassVar[Mapping[str, int]] = {"K": CELLS, "A": 1 + AZIMUTHS}

    max_range: float  # Largest range, metres
    # Detections of slower targets are learned as clutter, metres per second; see `clutter_map`.
    clutter_speed: float = 0.0
    # Number of detections in each cell that the configured probability predicts, (K,).
    expected: Annotated[FloatArray, floats("K", 0.0, MAX_REMEMBERED)] = zeros_field(CELLS)
    # Actual number of detections in each cell, (K,).
    detected: Annotated[FloatArray, floats("K", 0.0, MAX_REMEMBERED)] = zeros_field(CELLS)
    # Looks at targets, and expected and actual detections, in all cells. These sums have a memory
    # of their own.
    all_looks: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0
    all_expected: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0
    all_detected: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0
    # Trials that do not count yet.
    trials: Annotated[OpenTrials, nested(OpenTrials, K=CELLS)] = field(default_factory=OpenTrials)
    # Evidence of fewer detections by the sensor as a whole, and of almost none in each sector of
    # azimuth, (1 + A,).
    alarm: Annotated[FloatArray, floats("A", 0.0, MOST_EVIDENCE)] = zeros_field(1 + AZIMUTHS)
    # Factor of each cell when the evidence of its sector began, (K,); None if there was none yet.
    before: Annotated[FloatArray | None, floats("K", 0.0, MOST_FACTOR)] = None

    def expect(self, view: View) -> View:
        """Return the report with the learned probability."""
        return view.changed(detection=self)

    def learn(self, look: Look) -> Detection:
        """Add the trials of a report, and count those that its detections confirm.

        A target that was known stays known in a run of misses where misses are correlated, or the
        longest runs, which are frequent then, would not count. Targets at rest are clutter where a
        map of clutter has them, and may be detected less often than other targets.
        """
        if not look.view.complete:
            return self.learn_from_others(look)
        targets, existence = look.targets, look.targets.existence
        if look.view.look_prediction is not None:
            existence = np.where(np.isin(targets.label, self.trials.label), 1.0, existence)
        clutter = np.zeros(len(existence))
        if self.clutter_speed > 0.0:
            clutter = look.resting(self.clutter_speed)
        is_known = existence * (1.0 - clutter) >= KNOWN_EXISTENCE
        # Targets with a smaller detection probability count as outside the coverage.
        least_expected = 0.01
        is_known &= look.probability > least_expected
        cell = self.cell(look.view.sensor.visibility.place(targets.measured_by_target))
        expected = np.where(is_known, look.probability / self.by_cell[cell], 0.0)
        return self._after_trials(look, cell, expected)

    def learn_from_others(self, look: Look) -> Detection:
        """Count the trials that the detections of another sensor confirm."""
        size = len(look.targets.label)
        return self._after_trials(look, np.zeros(size, dtype=np.int64), np.zeros(size))

    def _after_trials(self, look: Look, cell: IntArray, expected: FloatArray) -> Detection:
        existence = look.association.existence
        share = np.minimum(look.detected_mass / np.maximum(existence, TINY), 1.0)
        label, exists = look.targets.label, np.minimum(existence, 1.0)
        own = ReportTrials(label, cell, expected, share, exists)
        opened, counted = self.trials.after(own, CELLS)
        factor = self.changed(trials=opened)
        return factor.with_alarm(counted).after(counted) if counted.trials.any() else factor

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return True

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the mean probability, its deviation, the configured one, and the alarms."""
        figures: dict[str, float] = {}
        if self.all_looks:
            figures["detection_probability"] = self.configured * self.mean
            figures["detection_probability_std"] = self.configured * self.std
            figures["detection_probability_set"] = self.configured
        if self.fewer_detections:
            figures["fewer_detections"] = 1.0
        if not np.isnan(self.blind_azimuth):
            figures["blind_azimuth_deg"] = float(np.degrees(self.blind_azimuth))
        return figures

    @property
    def entries(self) -> int:
        """Number of open trials."""
        return len(self.trials)

    def of_living(self, labels: IntArray) -> Detection:
        """Return the factor with open trials of these targets only, of ascending labels."""
        return self.changed(trials=self.trials.of(labels))

    @property
    def fewer_detections(self) -> bool:
        """Whether the sensor detects fewer targets than before."""
        return bool(self.alarm[0] >= RAISED)

    @property
    def blind_azimuth(self) -> float:
        """Middle of the sector that has become blind, radians; NaN without any.

        Of several such sectors it is the one with the most evidence.
        """
        sector = int(self.alarm[1:].argmax())
        if self.alarm[1 + sector] < RAISED:
            return math.nan
        return (sector + 0.5) * 2.0 * np.pi / AZIMUTHS

    @cached_property
    def _factors(self) -> tuple[float, float, FloatArray]:
        """Factor of the sensor as a whole, its deviation, and the factor of each cell."""
        from .loops import detection_factors

        assumed = self.configured if self.all_looks else MOST_PROBABILITY
        priors = FactorPriors(*SENSOR_PRIOR, *CELL_PRIOR, PRIOR_WEIGHT, MOST_PROBABILITY)
        totals = assumed, self.all_expected, self.all_detected
        return detection_factors(priors, *totals, self.expected, self.detected)

    @property
    def mean(self) -> float:
        """Factor of the sensor as a whole."""
        return self._factors[0]

    @property
    def std(self) -> float:
        """Standard deviation of `mean`."""
        return self._factors[1]

    @property
    def configured(self) -> float:
        """Mean of the configured probability over the looks; NaN without any."""
        return self.all_expected / self.all_looks if self.all_looks else math.nan

    @property
    def by_cell(self) -> FloatArray:
        """Factor of each cell, shape (K,)."""
        return self._factors[2]

    def cell(self, measured: FloatArray) -> IntArray:
        """Return the cells of (range, azimuth) rows, (N, 2) to (N,); ranges may be infinite."""
        ring = np.minimum(measured[:, 0] * (RANGES / self.max_range), RANGES - 1.0)
        turn = np.mod(measured[:, 1] * (AZIMUTHS / (2.0 * np.pi)), AZIMUTHS)
        sector = np.minimum(turn.astype(np.int64), AZIMUTHS - 1)
        cells: IntArray = ring.astype(np.int64) * AZIMUTHS + sector
        return cells

    def probability(self, configured: FloatArray, measured: FloatArray) -> FloatArray:
        """Return the learned probabilities, given the configured ones, both (..., N).

        `measured` has range and azimuth of each of the N places, (N, 2).
        """
        factor = self.by_cell.take(self.cell(measured))
        found = np.maximum(configured * factor, LEAST_PROBABILITY)
        probability: FloatArray = np.minimum(found, MOST_PROBABILITY)
        return probability

    def after(self, sums: TrialSums) -> Detection:
        """Return the factor after further trials."""
        trials, expected, detected = np.add.reduce(np.array(sums), axis=1).tolist()
        retention, fading = np.exp(-sums.expected / MEMORY), math.exp(-expected / MEMORY)
        return self.changed(
            expected=retention * self.expected + sums.expected,
            detected=retention * self.detected + sums.detected,
            all_looks=fading * self.all_looks + trials,
            all_expected=fading * self.all_expected + expected,
            all_detected=fading * self.all_detected + detected,
        )

    def with_alarm(self, sums: TrialSums) -> Detection:
        """Return the factor with the evidence of trials that count and are not learned yet."""
        from .loops import evidence_after_trials

        before = self.by_cell if self.before is None else self.before
        learned = frozen(LearnedFactors(self.by_cell, before, self.expected))
        alarm, factor_before = evidence_after_trials(
            self.alarm, CHANGES, learned, sums, self.all_expected
        )
        return self.changed(alarm=alarm, before=factor_before)
