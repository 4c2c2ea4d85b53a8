"""Counts a topic's lost messages by their sequence numbers, and notices several publishers.

Every publisher numbers its own messages, and they arrive in order. A message does not name its
publisher, so it is assigned to the publisher with the nearest lower number.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

# WINDOW is the number of latest messages that are considered. With MIN_DECREASES decreases of the
# number among them, several publishers are alive; a restart causes a single one.
WINDOW, MIN_DECREASES = 6, 2


@dataclass
class _Sequence:
    """One publisher's sequence of numbers."""

    number: int  # The number of its latest message
    received: int  # Number of messages received on the topic up to its latest message
    skipped: range = range(0)  # The numbers missing before its latest message


class SequenceNumbers:
    """The sequence numbers received on a topic.

    Messages that were published and not received are `lost`. With two publishers their number may
    fall, when a number arrives that was counted as lost.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._received = 0
        self._latest: int | None = None
        self._decreases: deque[bool] = deque(maxlen=WINDOW)
        self._sequences: list[_Sequence] = []

    def add(self, number: int) -> None:
        """Assign a message to the publisher with the nearest lower number, and count the gap."""
        self._received += 1
        self._decreases.append(self._latest is not None and number <= self._latest)
        self._latest = number
        # A dead publisher's sequence must not take its successor's numbers when they reach it.
        self._sequences = [s for s in self._sequences if self._received - s.received <= WINDOW]
        lower = [s for s in self._sequences if s.number < number]
        sequence = max(lower, key=lambda s: s.number) if lower else self._new_sequence(number)
        skipped = range(sequence.number + 1, number)
        if skipped:
            sequence.skipped = skipped
            self.lost += len(skipped)
        sequence.number, sequence.received = number, self._received

    def _new_sequence(self, number: int) -> _Sequence:
        """Return the sequence of another publisher, whose next message has `number`."""
        # If `number` was counted as lost in the gap of a sequence, the message after that gap came
        # from another publisher. The gap is taken back, and the new sequence begins before it.
        new = _Sequence(number - 1, self._received)
        for sequence in self._sequences:
            if number in sequence.skipped:
                self.lost -= len(sequence.skipped)
                new.number = sequence.skipped.start - 1
                sequence.skipped = range(0)
                break
        self._sequences.append(new)
        return new

    def begin_series(self) -> None:
        """Let the next message begin a new series, so that no gap before it counts as lost."""
        self._latest = None
        self._decreases.clear()
        self._sequences.clear()

    @property
    def several(self) -> bool:
        """Whether the latest messages come from several live publishers."""
        return sum(self._decreases) >= MIN_DECREASES
