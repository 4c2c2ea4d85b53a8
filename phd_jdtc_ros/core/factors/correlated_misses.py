"""Correlation of a sensor's detections of a target in consecutive looks.

With correlated misses, a target that was missed is probably missed again. The detections of a
target are a Markov chain from look to look. Its state, the last look of the sensor at the target,
is known with the probabilities of the association.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly, matches, zeros_field
from ..association.evidence import KNOWN_EXISTENCE
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import MAX_INDEX, MAX_STAMP_NS, floats, integers, nested
from .factor import Factor, Look
from .prior import RatioPrior

# Bounds of the correlation; at 1, a target that is missed once would never be detected again.
LEAST, MOST = 0.0, 0.98
# Prior of its difference from the value that learning starts from.
PRIOR = RatioPrior(right=0.5, scale=0.02, wide=0.4)
# Weight of that value, as a number of pairs of looks, so that the first pairs do not count alone.
PRIOR_WEIGHT = 4.0
# Memory, as a number of pairs of looks.
MEMORY = 1000.0
# Largest number of remembered pairs accepted in a snapshot.
MAX_REMEMBERED = 1e7
# Number of sums over pairs of looks; see `sums_of`.
SUMS = 6
# Columns of `DetectionChains` of floating-point numbers.
_NUMBERS = ("covered", "detected", "before_covered", "before_detected", "expected", "pairs")


def sums_of(
    detected: FloatArray,
    detected_before: FloatArray,
    expected: FloatArray,
    expected_before: FloatArray,
) -> FloatArray:
    """Return the summands of each pair of looks, (P, B), given values of shape (P,).

    `detected` is the probability that the later look detected the target, and `expected` its
    detection probability. A summand that depends on the order of the looks is the mean of both.
    """
    return np.stack(
        [
            np.ones(len(detected)),
            detected * detected_before,
            0.5 * (detected + detected_before),
            0.5 * (expected + expected_before),
            0.5 * (detected * expected_before + detected_before * expected),
            expected * expected_before,
        ],
        axis=1,
    )


class Trial(NamedTuple):
    """A look of a sensor as one trial of each of T targets, arrays of shape (T,)."""

    label: IntArray  # Ascending
    covered: FloatArray  # Probability that the look covers each target, if it exists
    detected: FloatArray  # Probability that the look detected each target, if it exists
    # Detection probability, whatever earlier looks saw; 0 if nothing can be learned from the look.
    expected: FloatArray
    existence: FloatArray  # Existence probability after the look
    known: BoolArray  # Whether each target certainly existed before the look


@dataclass(frozen=True)
class LookPrediction:
    """Detection probability of the next look, given the previous one; arrays of shape (K,).

    With the detection probability p, the correlation c, and the probabilities L and D that the
    previous look covered the target and detected it, the target is detected with
    p (1 - c L) + c D. The columns are c L and c D.
    """

    label: IntArray  # Ascending
    looked: FloatArray  # Correlation times the probability that the look covered it, c L
    detected: FloatArray  # Correlation times the probability that it detected it, c D

    @property
    def is_informative(self) -> bool:
        """Whether the next look depends on the previous one."""
        return bool(self.looked.any())

    def of(self, label: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the columns for the targets of some labels, 0 for unknown ones."""
        looked, detected = np.zeros((2, len(label)))
        row, own_row = matches(self.label, label)
        looked[row], detected[row] = self.looked[own_row], self.detected[own_row]
        return looked, detected

    def usual(self, probability: FloatArray, label: IntArray) -> FloatArray:
        """Return the usual probabilities, given those of the next look, (N,)."""
        looked, detected = self.of(label)
        return np.clip((probability - detected) / (1.0 - looked), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class DetectionChains(ReadOnly):
    """The last look of one sensor at each of K targets."""

    # Looks that cover a target with a smaller probability show nothing about the correlation.
    WHOLE: ClassVar[float] = 0.99
    # Sectors of one revolution belong to the same look for this share of the revolution.
    SAME_LOOK: ClassVar[float] = 0.5
    # Ascending, (K,).
    label: Annotated[IntArray, integers("K", 0, MAX_INDEX, ascending=True)] = zeros_field(
        0, dtype=np.int64
    )
    # Stamp of the look's first sector, (K,).
    stamp_ns: Annotated[IntArray, integers("K", 0, MAX_STAMP_NS)] = zeros_field(0, dtype=np.int64)
    # Probability that the look covered the target, (K,).
    covered: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    # Probability that the look detected the target, (K,).
    detected: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    # The columns `looked` and `detected` of `LookPrediction` that the look was given, (K,).
    before_covered: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    before_detected: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    # Detection probability of the look, (K,); see `Trial`.
    expected: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    # Sums over the pairs of looks that do not count yet, (K, B); see `sums_of`. As in
    # `detection`, they count when the target is detected again.
    pairs: Annotated[FloatArray, floats("KB", 0.0, MAX_REMEMBERED)] = zeros_field(0, SUMS)

    def __len__(self) -> int:
        return len(self.label)

    def of(self, labels: IntArray) -> DetectionChains:
        """Return the chains of the targets of ascending labels."""
        return self._take(matches(labels, self.label)[0])

    def _take(self, rows: IntArray) -> DetectionChains:
        columns = (getattr(self, name)[rows] for name in _NUMBERS)
        return DetectionChains(self.label[rows], self.stamp_ns[rows], *columns)

    def predict(self, stamp_ns: int, revolution_ns: float, correlation: float) -> LookPrediction:
        """Return what the chains predict for a look at a stamp.

        `revolution_ns` is the duration of a revolution, if the look is at a sector; otherwise 0.
        """
        is_earlier, looks = self._looks_before(stamp_ns, revolution_ns)
        factor = correlation**looks
        uncovered = 1.0 - self.covered
        covered = factor * (self.covered + uncovered * self.before_covered)
        detected = factor * (self.detected + uncovered * self.before_detected)
        return LookPrediction(
            self.label,
            np.where(is_earlier, covered, self.before_covered),
            np.where(is_earlier, detected, self.before_detected),
        )

    def _looks_before(self, stamp_ns: int, revolution_ns: float) -> tuple[BoolArray, FloatArray]:
        """Return which looks are before a new one at a stamp, and by how many looks."""
        if not revolution_ns:
            return np.ones(len(self.label), dtype=np.bool_), np.ones(len(self.label))
        elapsed_ns = stamp_ns - self.stamp_ns
        return elapsed_ns >= self.SAME_LOOK * revolution_ns, np.maximum(
            np.rint(elapsed_ns / revolution_ns), 1.0
        )

    def after(
        self, look: Trial, prediction: LookPrediction, stamp_ns: int, revolution_ns: float
    ) -> DetectionChains:
        """Return the chains after a further look, which was given `prediction`."""
        extended = self._extend(look.label)
        chains = extended._take(np.searchsorted(extended.label, look.label))
        is_earlier, looks = chains._looks_before(stamp_ns, revolution_ns)
        covered = np.where(is_earlier, 0.0, chains.covered) + look.covered
        detected = np.minimum(np.where(is_earlier, 0.0, chains.detected) + look.detected, 1.0)
        # Misses lower the existence probability; a target that was known stays known.
        is_known = look.known | (chains.expected > 0.0)
        learned = is_earlier & is_known & (look.covered > self.WHOLE)
        expected = np.where(learned, look.expected, 0.0)
        paired = (looks == 1.0) & (chains.expected > 0.0) & (expected > 0.0)
        sums = sums_of(look.detected, chains.detected, expected, chains.expected)
        before_covered, before_detected = prediction.of(look.label)
        return extended._replace_rows(
            DetectionChains(
                label=look.label,
                stamp_ns=np.where(is_earlier, stamp_ns, chains.stamp_ns),
                covered=np.clip(covered, detected, 1.0),
                detected=detected,
                before_covered=before_covered,
                before_detected=before_detected,
                expected=expected,
                pairs=chains.pairs + np.where(paired[:, None], sums, 0.0),
            )
        )

    def count_pairs(self, look: Trial) -> tuple[DetectionChains, FloatArray]:
        """Return the chains after any sensor's look, and the sums of pairs that count, (B,).

        If a target is detected with probability d, given that it exists, the share d of its pairs
        counts, times its existence probability, and the share 1 - d stays open.
        """
        chain, target = matches(look.label, self.label)
        detected, existence = look.detected[target], look.existence[target]
        sums: FloatArray = (detected * existence) @ self.pairs[chain]
        pairs = self.pairs.copy()
        pairs[chain] *= 1.0 - detected[:, None]
        return self.changed(pairs=pairs), sums

    def _extend(self, label: IntArray) -> DetectionChains:
        """Return these chains with empty ones for further labels."""
        labels = np.union1d(self.label, label)
        size = len(labels)
        columns = (np.zeros((size, *getattr(self, name).shape[1:])) for name in _NUMBERS)
        return DetectionChains(labels, np.zeros(size, dtype=np.int64), *columns)._replace_rows(self)

    def _replace_rows(self, other: DetectionChains) -> DetectionChains:
        """Return these chains with those of another value, whose labels are all among these."""
        rows, columns = np.searchsorted(self.label, other.label), {}
        for name in ("stamp_ns", *_NUMBERS):
            columns[name] = getattr(self, name).copy()
            columns[name][rows] = getattr(other, name)
        return self.changed(**columns)


@dataclass(frozen=True, eq=False)
class CorrelatedMisses(Factor):
    """Correlation of the detections of a target in consecutive looks of a sensor.

    The detections of a target are a Markov chain: with the detection probability p and the
    correlation c it is detected with p + c (1 - p) after a detection and with p (1 - c) after a
    miss, so that p is its stationary mean. The correlation of pairs (x, y) with the expectations
    (p, q) is the mean of (x - f p)(y - f q) relative to that of f p (1 - f q), where the factor f
    brings the expectations to the mean of the detections. With a = p + c (1 - p) and b = p (1 - c),
    its variance is [a (1 - a) / p + b (1 - b) / (1 - p)] / n after n pairs.

    References
    ----------
    Klotz, "Statistical inference in Bernoulli trials with dependence", Annals of Statistics 1(2),
    1973.
    """

    NAME: ClassVar[str] = "correlation"
    SIZES: ClassVar[Mapping[str, int]] = {"B": SUMS}

    start: float  # The correlation, or the one that learning starts from
    learned: bool  # Whether it is learned
    # Sums over the remembered pairs of looks, (B,); see `sums_of`.
    sums: Annotated[FloatArray, floats("B", 0.0, MAX_REMEMBERED)] = zeros_field(SUMS)
    # The last look at each target.
    chains: Annotated[DetectionChains, nested(DetectionChains, B=SUMS)] = field(
        default_factory=DetectionChains
    )

    def expect(self, view: View) -> View:
        """Return the report with what the last looks predict of it."""
        prediction = self.chains.predict(view.stamp_ns, view.revolution_ns, self.value)
        return view.changed(look_prediction=prediction)

    def learn(self, look: Look) -> CorrelatedMisses:
        """Continue the chains with a look, and learn from the pairs that it confirms."""
        view, prediction = look.view, look.view.look_prediction
        if not isinstance(prediction, LookPrediction):
            return self
        trial = _trial_of(look, prediction)
        counted = self._count(trial)
        chains = counted.chains.after(trial, prediction, view.stamp_ns, view.revolution_ns)
        return counted.changed(chains=chains)

    def learn_from_others(self, look: Look) -> CorrelatedMisses:
        """Learn from the pairs that the detections of another sensor confirm."""
        return self._count(_trial_of(look, None)) if len(self.chains) else self

    def _count(self, trial: Trial) -> CorrelatedMisses:
        if not self.learned:
            return self
        chains, sums = self.chains.count_pairs(trial)
        return (self.after(sums) if sums[0] > 0.0 else self).changed(chains=chains)

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return self.learned

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the learned correlation and its standard deviation."""
        if self.std == math.inf:
            return {}
        return {"detection_correlation": self.value, "detection_correlation_std": self.std}

    @property
    def entries(self) -> int:
        """Number of chains."""
        return len(self.chains)

    def of_living(self, labels: IntArray) -> CorrelatedMisses:
        """Return the factor with chains of these targets only, of ascending labels."""
        return self.changed(chains=self.chains.of(labels))

    @cached_property
    def value(self) -> float:
        """The correlation."""
        estimate, precision = self._estimate
        posterior, _ = PRIOR.posterior(np.array([estimate - self.start]), np.array([precision]))
        return min(max(self.start + float(posterior[0]), LEAST), MOST)

    @property
    def std(self) -> float:
        """Standard deviation of `value`, given by the pairs alone; infinite without pairs."""
        precision = self._estimate[1]
        return 1.0 / math.sqrt(precision) if precision else math.inf

    @cached_property
    def _estimate(self) -> tuple[float, float]:
        """The correlation that the pairs show, and the inverse of its variance."""
        pairs, both_detected, detected, expected, crossed, square = self.sums.tolist()
        if not self.learned or expected <= 0.0 or not 0.0 < detected < pairs:
            return self.start, 0.0
        factor = detected / expected
        covariance = both_detected - 2.0 * factor * crossed + factor**2 * square
        variance = max(detected - factor**2 * square, 1e-9)
        prior = PRIOR_WEIGHT * variance / pairs
        estimate = (covariance + self.start * prior) / (variance + prior)
        estimate = min(max(estimate, -MOST), MOST)
        # Half a detection and half a miss are added, so that pairs without one of them show little.
        mean, positive = (detected + 0.5) / (pairs + 1.0), max(estimate, 0.0)
        hit, miss = mean + positive * (1.0 - mean), mean * (1.0 - positive)
        spread = hit * (1.0 - hit) / mean + miss * (1.0 - miss) / (1.0 - mean)
        return estimate, pairs / spread

    def after(self, sums: FloatArray) -> CorrelatedMisses:
        """Return the correlation after further pairs, given their sums, (B,)."""
        retention = math.exp(-float(sums[0]) / MEMORY)
        return self.changed(sums=retention * self.sums + sums)


def _trial_of(look: Look, prediction: LookPrediction | None) -> Trial:
    """Return a look as a trial; newborn targets cannot have been expected."""
    targets, born = look.targets, np.zeros(len(look.born))
    size, sector = len(targets.label), look.view.detections.coverage
    sensor, measured = look.view.sensor, targets.measured_by_target
    expected = np.zeros(size)
    if prediction is not None and look.view.complete:
        expected = prediction.usual(look.probability, targets.label)
    covered = sensor.visibility.coverage_probability(measured, sector, sensor.noise_std)
    existence = np.minimum(look.association.existence, 1.0)
    return Trial(
        look.label,
        np.concatenate([covered, born + 1.0]),
        look.detected,
        np.concatenate([expected, born]),
        np.concatenate([existence, born]),
        np.concatenate([targets.existence >= KNOWN_EXISTENCE, born > 0.0]),
    )
