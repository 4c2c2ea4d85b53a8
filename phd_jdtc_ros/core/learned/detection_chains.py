"""The last look of a sensor at each target: whether it covered the target, and detected it.

With correlated misses, a target that was missed is probably missed again. The detections of a
target are a Markov chain from look to look. Its state is known with the probabilities of the
association.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly, matches, zeros_field
from ..snapshot import MAX_INDEX, MAX_STAMP_NS, floats, integers
from .correlation import MAX_REMEMBERED, SUMS, sums_of

# Sectors of one turn belong to the same look for this share of the turn.
SAME_LOOK = 0.5
# Looks that cover a target with a smaller probability show nothing about the correlation.
WHOLE = 0.99
# Columns of `DetectionChains` of floating-point numbers.
_NUMBERS = ("covered", "detected", "before_covered", "before_detected", "expected", "pairs")


class Look(NamedTuple):
    """A look of a sensor at T targets, arrays of shape (T,)."""

    label: IntArray  # Ascending
    covered: FloatArray  # Probability that the look covers each target, if it exists
    detected: FloatArray  # Probability that the look detected each target, if it exists
    # Detection probability, whatever earlier looks saw; 0 if nothing can be learned from the look.
    expected: FloatArray
    existence: FloatArray  # Existence probability after the look
    known: BoolArray  # Whether each target certainly existed before the look

    def with_born(self, label: IntArray) -> Look:
        """Return the look with targets of larger labels, born at its detections."""
        if not len(label):
            return self
        ones, zeros = np.ones(len(label)), np.zeros(len(label))
        return Look(
            np.concatenate([self.label, label]),
            np.concatenate([self.covered, ones]),
            np.concatenate([self.detected, ones]),
            np.concatenate([self.expected, zeros]),
            np.concatenate([self.existence, zeros]),
            np.concatenate([self.known, zeros > 0.0]),
        )


@dataclass(frozen=True)
class LookPrediction:
    """Detection probability of the next look, given the previous one; arrays of shape (K,).

    With the detection probability p, the correlation c, and the probabilities L and D that the
    previous look covered the target and detected it, the target is detected with
    p (1 - c L) + c D. The columns are c L and c D.
    """

    label: IntArray  # Ascending
    looked: FloatArray  # c L: correlation times the probability that the look covered the target
    detected: FloatArray  # c D: correlation times the probability that it detected the target

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

    def probability(self, usual: FloatArray, label: IntArray) -> FloatArray:
        """Return the detection probabilities of rows, given the usual ones, both (..., N).

        `label` has the label of each row's target, (N,).
        """
        looked, detected = self.of(label)
        return usual * (1.0 - looked) + detected

    def usual(self, probability: FloatArray, label: IntArray) -> FloatArray:
        """Return the usual probabilities, given those that `probability` returns, (N,)."""
        looked, detected = self.of(label)
        return np.clip((probability - detected) / (1.0 - looked), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class DetectionChains(ReadOnly):
    """The last look of one sensor at each of K targets."""

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
    # Detection probability of the look, (K,); see `Look`.
    expected: Annotated[FloatArray, floats("K", 0.0, 1.0)] = zeros_field(0)
    # Sums over the pairs of looks that do not count yet, (K, B); see `correlation.sums_of`. As in
    # `open_trials`, they count when the target is detected again.
    pairs: Annotated[FloatArray, floats("KB", 0.0, MAX_REMEMBERED)] = zeros_field(0, SUMS)

    def __len__(self) -> int:
        return len(self.label)

    def of(self, labels: IntArray) -> DetectionChains:
        """Return the chains of the targets of ascending labels."""
        return self._take(matches(labels, self.label)[0])

    def _take(self, rows: IntArray) -> DetectionChains:
        columns = (getattr(self, name)[rows] for name in _NUMBERS)
        return DetectionChains(self.label[rows], self.stamp_ns[rows], *columns)

    def predict(self, stamp_ns: int, turn_ns: float, correlation: float) -> LookPrediction:
        """Return what the chains predict for a look at a stamp.

        `turn_ns` is the duration of a turn, if the look is at a sector; otherwise 0.
        """
        is_earlier, looks = self._looks_before(stamp_ns, turn_ns)
        factor = correlation**looks
        uncovered = 1.0 - self.covered
        covered = factor * (self.covered + uncovered * self.before_covered)
        detected = factor * (self.detected + uncovered * self.before_detected)
        return LookPrediction(
            self.label,
            np.where(is_earlier, covered, self.before_covered),
            np.where(is_earlier, detected, self.before_detected),
        )

    def _looks_before(self, stamp_ns: int, turn_ns: float) -> tuple[BoolArray, FloatArray]:
        """Return which looks are before a new one at a stamp, and by how many looks."""
        if not turn_ns:
            return np.ones(len(self.label), dtype=np.bool_), np.ones(len(self.label))
        elapsed_ns = stamp_ns - self.stamp_ns
        return elapsed_ns >= SAME_LOOK * turn_ns, np.maximum(np.rint(elapsed_ns / turn_ns), 1.0)

    def after(
        self, look: Look, prediction: LookPrediction, stamp_ns: int, turn_ns: float
    ) -> DetectionChains:
        """Return the chains after a further look, which was given `prediction`."""
        extended = self._extend(look.label)
        chains = extended._take(np.searchsorted(extended.label, look.label))
        is_earlier, looks = chains._looks_before(stamp_ns, turn_ns)
        covered = np.where(is_earlier, 0.0, chains.covered) + look.covered
        detected = np.minimum(np.where(is_earlier, 0.0, chains.detected) + look.detected, 1.0)
        # Misses lower the existence probability; a target that was known stays known.
        is_known = look.known | (chains.expected > 0.0)
        learned = is_earlier & is_known & (look.covered > WHOLE)
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

    def count_pairs(self, look: Look) -> tuple[DetectionChains, FloatArray]:
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
