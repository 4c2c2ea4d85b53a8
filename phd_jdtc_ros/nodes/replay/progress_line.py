"""A line on the terminal that shows a replay's progress."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class ProgressLine:
    """A line on the terminal with the bag's time; not drawn if there is no terminal."""

    def __init__(self, first_s: float, last_s: float) -> None:
        console = Console()
        self._progress = Progress(
            TextColumn("replay {task.fields[doing]}"),
            BarColumn(),
            TextColumn("{task.fields[time]:.1f} of {task.fields[last]:.1f} s"),
            TextColumn("{task.fields[scans]} scans"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._first_s = first_s
        self._length_s = max(last_s - first_s, 1e-9)
        self._scans = 0
        self._task = self._progress.add_task(
            "replay", total=self._length_s, scans=0, time=first_s, last=last_s, doing="waiting"
        )
        self._progress.start()

    def show(self, time_s: float, doing: str, scans: int = 0) -> None:
        """Show the bag's time and the activity, and add to the count of scans."""
        self._scans += scans
        self._progress.update(
            self._task,
            completed=time_s - self._first_s,
            scans=self._scans,
            time=time_s,
            doing=doing,
        )

    def stop(self) -> None:
        """Stop drawing; the line stays."""
        self._progress.stop()
