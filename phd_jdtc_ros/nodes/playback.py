"""The scans of a bag in order, and a bar that shows how far they are."""

from __future__ import annotations

from collections.abc import Iterator

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from msg_adapters.bag import BagError, BagMessage, BagReader


class Playback:
    """Reads a chosen part of a bag, stamp by stamp, one stamp ahead.

    Parameters
    ----------
    bag : BagReader
    topics : list of str
    start_s : float
        Skip this much.
    duration_s : float
        Take this much; 0 for all.

    Attributes
    ----------
    upcoming : list of BagMessage or None
        The messages of the next stamp; None at the end.
    damage : BagError or None
        What was wrong with the bag, known once the end is reached.

    Raises
    ------
    BagError
        If there is nothing to play.
    """

    def __init__(
        self, bag: BagReader, topics: list[str], start_s: float, duration_s: float
    ) -> None:
        self._bag = bag
        self._topics = topics
        self._first_ns = bag.start_ns + round(start_s * 1e9)
        self._last_ns = bag.end_ns
        if duration_s:
            self._last_ns = min(self._last_ns, self._first_ns + round(duration_s * 1e9))
        self.damage: BagError | None = None
        self.rewind()
        if self.upcoming is None:
            raise self.damage or BagError(f"{bag.path}: holds nothing in the chosen part")

    def rewind(self) -> None:
        """Go to the first stamp."""
        self._source = self._scans()
        self.upcoming = next(self._source, None)

    def advance(self) -> None:
        """Go to the next stamp."""
        self.upcoming = next(self._source, None)

    @property
    def progress(self) -> float:
        """How much has been played, 0 to 1."""
        if self.upcoming is None:
            return 1.0
        length = max(1, self._last_ns - self._first_ns)
        return (self.upcoming[0].log_time_ns - self._first_ns) / length

    def _scans(self) -> Iterator[list[BagMessage]]:
        scan: list[BagMessage] = []
        try:
            for message in self._bag.messages(self._topics):
                if not self._first_ns <= message.log_time_ns <= self._last_ns:
                    continue
                if scan and message.stamp_ns != scan[0].stamp_ns:
                    yield scan
                    scan = []
                scan.append(message)
        except BagError as error:
            self.damage = error
        if scan:
            yield scan


class ProgressBar:
    """A bar on the terminal, or nothing."""

    def __init__(self, shown: bool) -> None:
        self._progress = Progress(
            TextColumn("replay"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[scans]} scans"),
            TimeElapsedColumn(),
            disable=not shown,
        )
        self._scans = 0
        self._task = self._progress.add_task("replay", total=1.0, scans=0)
        self._progress.start()

    def show(self, completed: float) -> None:
        """Count one more scan and show the share that is done."""
        self._scans += 1
        self._progress.update(self._task, completed=completed, scans=self._scans)

    def stop(self) -> None:
        """Leave the bar as it is."""
        self._progress.stop()
