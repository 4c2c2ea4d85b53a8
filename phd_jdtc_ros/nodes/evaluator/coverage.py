"""What of the truth and of the estimates arrived, and what of it could be scored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.evaluation import Evaluation
from phd_jdtc_ros.evaluation.true_tracks import LONGEST_INTERPOLATION_S

from ..common.sequence_numbers import SequenceNumbers

# Stamps of the truth and of the estimates, none of which fit, after which the node says so.
UNMATCHED = 20


@dataclass
class Coverage:
    """Counts the clouds of the truth and of the estimates.

    Parameters
    ----------
    truth : str
        Topic of the truth.

    Attributes
    ----------
    received, refused : Counter
        Clouds by topic: those taken, and those that do not fit.
    """

    truth: str
    estimates: Mapping[str, str]
    received: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    _first_ns: dict[str, int] = field(default_factory=dict)
    _numbers: dict[str, SequenceNumbers] = field(default_factory=dict)

    def arrived(self, topic: str, sequence: int | None) -> None:
        """Count the clouds lost before this one by its publisher's number for it."""
        if sequence is not None:
            self._numbers.setdefault(topic, SequenceNumbers()).add(sequence)

    def take(self, topic: str, stamp_ns: int) -> None:
        """Count a cloud that fits."""
        self.received[topic] += 1
        self._first_ns.setdefault(topic, stamp_ns)

    def unmatched(self, evaluation: Evaluation) -> str | None:
        """Return that no time fits, once there are enough of both; None before and otherwise."""
        few = min(self.received[self.truth], max(map(self._count, SOURCES))) < UNMATCHED
        return None if few or any(evaluation.scored.values()) else self._no_common_time()

    def nothing_scored(self) -> str:
        """Return why no scan has been scored."""
        found = sum(map(self._count, SOURCES))
        if not self.received[self.truth] and not found:
            return f"nothing is scored: neither truth on {self.truth} nor estimates came"
        if not self.received[self.truth]:
            return f"nothing is scored: no truth came on {self.truth}"
        if not found:
            return f"nothing is scored: no estimates came on {' or '.join(self.estimates.values())}"
        return self._no_common_time()

    def gaps(self, evaluation: Evaluation) -> Iterator[str]:
        """Yield what was not scored, or was not even received."""
        for source, scored in evaluation.scored.items():
            missing = 0 if evaluation.own_stamps else evaluation.truth_scans - scored
            if missing:
                yield f"{missing} of {evaluation.truth_scans} scans have no {source} estimates"
        for topic, numbers in sorted(self._numbers.items()):
            if numbers.lost:
                yield f"{numbers.lost} messages on {topic} were lost on the way here"
        for topic, count in sorted(self.refused.items()):
            yield f"{count} clouds on {topic} did not fit"
        if evaluation.repeated:
            yield f"{evaluation.repeated} clouds had a stamp that was there already"

    def _count(self, source: str) -> int:
        return self.received[self.estimates[source]]

    def _no_common_time(self) -> str:
        topics = [self.truth, *(t for t in self.estimates.values() if t in self._first_ns)]
        firsts = ", ".join(f"{t} begins at {self._first_ns[t] / 1e9:.3f} s" for t in topics)
        return (
            "nothing is scored: no estimates are at a stamp of the truth, or between two that are "
            f"at most {LONGEST_INTERPOLATION_S:g} s apart ({firsts})"
        )
