"""The received truth and estimates: how much was scored, and whether it is enough."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.true_tracks import LONGEST_INTERPOLATION_S

from ..common.sequence_numbers import SequenceNumbers

# A warning is due once this many stamps, of the truth and of the estimates, have none in common.
UNMATCHED = 20
# Time after the last score in which further messages can still arrive for the recording, seconds.
LINGER_S = 0.5


@dataclass
class ReceivedClouds:
    """Counts the clouds of the truth and of the estimates."""

    truth: str  # Its topic
    estimates: Mapping[str, str]  # Their topics by source
    # Numbers of valid and of invalid clouds by topic.
    received: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    _first_ns: dict[str, int] = field(default_factory=dict)
    _numbers: dict[str, SequenceNumbers] = field(default_factory=dict)

    def count_losses(self, topic: str, sequence: int | None) -> None:
        """Count the clouds lost before this one, by its publisher's number for it."""
        if sequence is not None:
            self._numbers.setdefault(topic, SequenceNumbers()).add(sequence)

    def take(self, topic: str, stamp_ns: int) -> None:
        """Count a valid cloud."""
        self.received[topic] += 1
        self._first_ns.setdefault(topic, stamp_ns)

    def mismatch(self, evaluation: Evaluation) -> str | None:
        """Return the warning that no stamps are common, once there are enough; None otherwise."""
        few = min(self.received[self.truth], max(map(self._count, SOURCES))) < UNMATCHED
        return None if few or any(evaluation.scored.values()) else self._no_common_time()

    def no_score_reason(self) -> str:
        """Return the reason for which no scan has been scored."""
        found = sum(map(self._count, SOURCES))
        if not self.received[self.truth] and not found:
            return f"nothing is scored: neither truth on {self.truth} nor estimates were received"
        if not self.received[self.truth]:
            return f"nothing is scored: no truth was received on {self.truth}"
        if not found:
            topics = " or ".join(self.estimates.values())
            return f"nothing is scored: no estimates were received on {topics}"
        return self._no_common_time()

    def gaps(self, evaluation: Evaluation) -> Iterator[str]:
        """Yield the numbers of scans and clouds that were not scored, by reason."""
        for source, scored in evaluation.scored.items():
            missing = 0 if evaluation.own_stamps else evaluation.truth_scans - scored
            if missing:
                yield f"{missing} of {evaluation.truth_scans} scans have no {source} estimates"
        for topic, numbers in sorted(self._numbers.items()):
            if numbers.lost:
                yield f"{numbers.lost} messages on {topic} were lost on the way"
        for topic, count in sorted(self.refused.items()):
            yield f"{count} clouds on {topic} were rejected"
        if evaluation.repeated:
            yield f"{evaluation.repeated} clouds repeated a stamp"

    def _count(self, source: str) -> int:
        return self.received[self.estimates[source]]

    def _no_common_time(self) -> str:
        topics = [self.truth, *(t for t in self.estimates.values() if t in self._first_ns)]
        firsts = ", ".join(f"{t} begins at {self._first_ns[t] / 1e9:.3f} s" for t in topics)
        return (
            "nothing is scored: no estimates are at a stamp of the truth, or between two that are "
            f"at most {LONGEST_INTERPOLATION_S:g} s apart ({firsts})"
        )


class Completion:
    """Decides when enough stamps are scored, and late messages have had time to arrive.

    `wanted` is the number of stamps; 0 if the evaluation has no end.
    """

    def __init__(self, evaluation: Evaluation, wanted: int) -> None:
        self._evaluation, self._wanted = evaluation, wanted
        self._scored: tuple[int, ...] = ()
        self._since_s = 0.0

    def is_reached(self, now_s: float) -> bool:
        """Return whether no score was added for `LINGER_S` after the wanted number."""
        scored = tuple(self._evaluation.scored.values())
        if not self._wanted or not self._is_enough(scored):
            return False
        if scored != self._scored:
            self._scored, self._since_s = scored, now_s
        return now_s - self._since_s >= LINGER_S

    def _is_enough(self, scored: Sequence[int]) -> bool:
        """Return whether the wanted number of stamps has the scores of both sources."""
        # The number of estimates with stamps of their own is not known in advance. Then the truth
        # must have that number of stamps, and both sources the same number of scores.
        if self._evaluation.own_stamps:
            return self._evaluation.truth_scans >= self._wanted and min(scored) == max(scored)
        return min(scored) >= self._wanted
