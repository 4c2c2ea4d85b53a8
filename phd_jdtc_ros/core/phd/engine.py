"""The engine of the paper's room: a recursion over the scans, with a fixed-lag window."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, NoReturn, Protocol, TypeVar

from ..arrays import FloatArray
from ..engine import Lag, OnFiltered, Step, ignore_filtered
from ..models.tracker_model import TrackerModel
from ..tracks.reporting_rule import ReportingRule
from ..types import Estimates, Scan
from ..types.clutter_raster import ClutterRaster

# An intensity, and what the backward step to the intensity before needs.
SetT = TypeVar("SetT")
LinkT = TypeVar("LinkT")


@dataclass(frozen=True)
class Stepped(Generic[SetT, LinkT]):
    """The result of one step of a recursion."""

    corrected: SetT  # The intensity after all radars, from which filtered targets are extracted
    stored: SetT  # The same resampled or merged, from which the next scan continues
    link: LinkT | None  # None for the first scan, and without smoothing
    figures: Mapping[str, float]  # Diagnostics by name


class Recursion(Protocol[SetT, LinkT]):
    """A PHD filter and the backward step of its smoother."""

    model: TrackerModel

    def reset(self) -> None:
        """Return to the initial state."""

    def step(
        self, earlier: SetT | None, scan: Scan, dt: float, linked: bool
    ) -> Stepped[SetT, LinkT]:
        """Predict by `dt` seconds and correct; `earlier` is the stored intensity before, if any."""

    def backward_step(self, stored: SetT, link: LinkT, later: SetT) -> SetT:
        """Return the smoothed intensity, given the stored one and the smoothed next one.

        `link` joins the stored intensity to the next one.
        """

    def extract(self, found: SetT, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Return the targets of an intensity with a mass above the threshold."""

    def class_mass(self, found: SetT) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,)."""


@dataclass(frozen=True)
class Entry(Generic[SetT, LinkT]):
    """A scan of the window."""

    stamp_ns: int
    stored: SetT
    link: LinkT | None  # To the entry before


def backward_pass(
    window: Sequence[Entry[SetT, LinkT]], recursion: Recursion[SetT, LinkT]
) -> Iterator[SetT]:
    """Yield the smoothed intensities of a window, newest first: lag 0, lag 1 and so on.

    Sec. IV-C, Step 4, for t = k - 1, ..., k - L.
    """
    later, smoothed = window[-1], window[-1].stored
    yield smoothed
    for entry in window[-2::-1]:
        if later.link is None:
            raise ValueError("window: an entry after the first has no link")
        smoothed = recursion.backward_step(entry.stored, later.link, smoothed)
        later = entry
        yield smoothed


@dataclass
class PhdEngine(Generic[SetT, LinkT]):
    """A PHD filter with a fixed-lag backward smoother; implements the protocol `Engine`.

    Estimates have no track numbers. Its state can be neither stored nor restored; the configuration
    therefore refuses checkpoints and out-of-sequence reports with it.
    """

    recursion: Recursion[SetT, LinkT]
    lag: Lag
    rule: ReportingRule
    _latest: Entry[SetT, LinkT] | None = field(init=False, repr=False)
    _window: list[Entry[SetT, LinkT]] = field(init=False, repr=False)  # Not yet smoothed

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self.recursion.reset()
        self._latest, self._window = None, []

    def step(self, scan: Scan, on_filtered: OnFiltered = ignore_filtered) -> Step:
        """Filter one scan and smooth the scans whose lag is reached; see `Engine.step`."""
        dt, latest = self.recursion.model.modes.interval_s, self._latest
        if latest is not None:
            dt = (scan.stamp_ns - latest.stamp_ns) * 1e-9
        if dt <= 0.0:
            raise ValueError(f"scan.stamp_ns: {scan.stamp_ns} is not later than the scan before")
        earlier = None if latest is None else latest.stored
        found = self.recursion.step(earlier, scan, dt, linked=self.lag.positive)
        self._latest = Entry(scan.stamp_ns, found.stored, found.link)
        self._window.append(self._latest)
        filtered = (self._extract(found.corrected, scan.stamp_ns, 0),)
        on_filtered(filtered)
        stamps_ns, due = [entry.stamp_ns for entry in self._window], 0
        while self.lag.reached(stamps_ns[due:]):
            due += 1
        mass = self.recursion.class_mass(found.corrected)
        return Step(filtered, self._smooth(due), mass, found.figures)

    def _smooth(self, count: int) -> tuple[Estimates, ...]:
        """Return the targets of the oldest entries of the window, oldest first, and drop these."""
        estimates = [*self.smoothed(len(self._window) - count)] if count else []
        self._window = self._window[count:]
        return tuple(reversed(estimates))

    def smoothed(self, least_lag: int = 0) -> Iterator[Estimates]:
        """Yield the targets of the window's scans, newest first, beginning at `least_lag`.

        The lag of a scan is the number of later scans, with all of which it is smoothed.
        """
        for lag, found in enumerate(backward_pass(self._window, self.recursion)):
            if lag >= least_lag:
                yield self._extract(found, self._window[-1 - lag].stamp_ns, lag)

    def _extract(self, found: SetT, stamp_ns: int, lag: int) -> Estimates:
        """Return the reported targets of an intensity."""
        estimates = self.recursion.extract(found, stamp_ns, lag, self.rule.least)
        return estimates.select(self.rule.reported[estimates.class_id])

    def flush(self) -> tuple[Estimates, ...]:
        """Return the targets of the window, smoothed with all its scans, and begin again."""
        pending = self._smooth(len(self._window))
        self.reset()
        return pending

    def interrupt(self) -> tuple[Estimates, ...]:
        """Flush; there are no track numbers to keep."""
        return self.flush()

    def retune(self, model: TrackerModel, rule: ReportingRule) -> None:
        """Use another model and rule from the next scan on; see `Engine.retune`."""
        self.recursion.model, self.rule = model, rule

    def clutter_raster(self) -> ClutterRaster | None:
        """Return None: nothing is learned."""
        return None

    @property
    def track_count(self) -> int:
        """The latest track number: there is none."""
        return 0

    def start_track(self, *_: object) -> None:
        """Refuse: its estimates are no tracks."""
        raise ValueError("engine: a PHD filter has no tracks")

    def paths(self, *_: object) -> None:
        """Return None: its estimates are no tracks."""

    def _refuse(self, *_: object) -> NoReturn:
        raise ValueError("engine: a PHD filter keeps no state to return to")

    save_state = reprocess = snapshot = restore = _refuse
