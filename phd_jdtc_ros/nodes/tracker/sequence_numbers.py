# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the numbers of a topic's messages tell: how many were lost, and whether several publish.

Every publisher numbers its own messages, and they come in their order; which publisher a message is
of, nobody says.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

# Messages that are looked back on.
WINDOW = 6
# So many numbers that do not go up among them are no restart, which is one.
TURNS = 2


@dataclass
class _Count:
    """One publisher's count.

    Parameters
    ----------
    number : int
        Of its latest message.
    heard : int
        How many messages there had been on the topic by then, this one included.
    skipped : range
        The numbers that it left out last.
    """

    number: int
    heard: int
    skipped: range = range(0)


class SequenceNumbers:
    """The numbers that have come on a topic.

    Attributes
    ----------
    lost : int
        Messages that were published and did not come. While two publish it may fall: when a number
        comes that was taken for lost.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._heard = 0
        self._latest: int | None = None
        self._turns: deque[bool] = deque(maxlen=WINDOW)
        self._counts: list[_Count] = []

    def add(self, number: int) -> None:
        """Take note of a message; it goes on with the count that it comes closest behind."""
        self._heard += 1
        self._turns.append(self._latest is not None and number <= self._latest)
        self._latest = number
        # A dead publisher's would catch its successor's numbers as those come by.
        self._counts = [count for count in self._counts if self._heard - count.heard <= WINDOW]
        lower = [count for count in self._counts if count.number < number]
        count = max(lower, key=lambda each: each.number) if lower else self._another(number)
        skipped = range(count.number + 1, number)
        if skipped:
            count.skipped = skipped
            self.lost += len(skipped)
        count.number, count.heard = number, self._heard

    def _another(self, number: int) -> _Count:
        """Return a publisher's count that `number` goes on with: a new one, or one found out."""
        found = _Count(number - 1, self._heard)
        for count in self._counts:
            if number in count.skipped:
                # Here another publisher's number was taken for the next of this one.
                self.lost -= len(count.skipped)
                found.number = count.skipped.start - 1
                count.skipped = range(0)
                break
        self._counts.append(found)
        return found

    @property
    def several(self) -> bool:
        """Whether the latest messages are of publishers that publish side by side."""
        return sum(self._turns) >= TURNS
