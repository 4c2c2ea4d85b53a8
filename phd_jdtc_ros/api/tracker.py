"""The tracker for tables of detections."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from os import PathLike
from typing import Any, NamedTuple

from msg_adapters.selection import Report
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import limit_plots, plots_of
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.pipeline import Event, RunEnded
from phd_jdtc_ros.core.types import Detections, Estimates
from phd_jdtc_ros.feed.feed import Feed
from phd_jdtc_ros.feed.tally import Tally

from .parameters import Parameters
from .reports import TIME, beyond_any_range, report_of, reports_of
from .tables import Column, Table, columns_of, stamps_ns, table_of


class Tracks(NamedTuple):
    """Estimates of targets, as tables; see `Tracker` for their columns.

    Parameters
    ----------
    filtered : structured array
        With the detections until their time.
    smoothed : structured array
        With later ones too, within the lag: more accurate, and some scans later.
    """

    filtered: Column
    smoothed: Column


class Tracker:
    """Detects, tracks and classifies targets in tables of detections.

    Parameters
    ----------
    parameters : mapping, str, path or None
        The tracker's parameters, by dotted or nested names, see ``docs/parameters.md``. Here they
        begin with one radar, named ``radar``, and one class of targets, ``target``, that may appear
        anywhere. ``interval_s`` and each radar's ``range_std``, ``azimuth_std_deg`` and
        ``max_range`` have to be given, or found by `fit`. A str or a path is a parameter file of
        the node, with the node's defaults.

    Attributes
    ----------
    parameters : dict
        Those that are given or found, by dotted name.
    dropped : Counter
        Detections and reports that were not used, by reason.

    Raises
    ------
    ConfigError
        A ValueError, with every fault of the parameters.

    Notes
    -----
    Tables of detections are mappings of column to values, data frames, structured arrays or paths
    of CSV files. Their columns are ``time`` (seconds, or dates), ``radar`` (its name; with several
    radars), ``range`` and ``azimuth`` (metres; radians counter-clockwise from the radar's x axis
    unless ``azimuth_unit`` and ``azimuth_convention`` say otherwise) or ``x`` and ``y`` (metres, in
    the world frame, with the deviation ``position_std`` or else ``range_std``), and what else
    ``fields`` names. Columns with the names of its parameters (``amplitude``, ``height``, ``code``,
    ``range_rate`` and so on) are used if they are there; others are not looked at.

    Rows of one time and one radar are one scan: targets that have no row in it were missed. A
    scan without any detection is a row with a time and nothing else. Where an antenna turns, each
    detection has a time of its own: ``fields.time: time`` says so. Times count in microseconds.

    Tables of tracks are structured arrays, a row for each target and time:

    ===================== =================================================================
    ``time``              seconds, of the state
    ``label``             number of the track, from 1; 0 without one
    ``class``             name of the most probable class
    ``class_probability`` its probability
    ``probability``       that the target exists
    ``state``             ``tentative``, ``confirmed`` or ``coasting`` (not detected lately)
    ``x y``               position in the world frame, metres
    ``vx vy``             velocity, metres per second
    ``height``            metres; NaN where it is not known
    ``code address``      Mode A code and Mode S address; -1 where there is none
    ``covariance``        of ``x y vx vy``, shape (4, 4)
    ===================== =================================================================

    The same detections give the same tracks, at once by `track` or step by step by `update`, and
    as the live node has them.
    """

    def __init__(self, parameters: Mapping[str, Any] | str | PathLike[str] | None = None) -> None:
        self._parameters = Parameters.of(parameters)
        self._run: _Run | None = None
        self.dropped: Counter[str] = Counter()
        # Faults in values are told now; what is not known yet is not.
        self._parameters.config(blank=True)

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters that are given or found, by dotted name."""
        return self._parameters.values()

    def fit(self, detections: Table) -> Tracker:
        """Find the parameters that are not given: noise, detection probability, clutter, turns.

        Parameters
        ----------
        detections : table
            Some minutes with a few targets: at least ten scans, and thirty detections of targets
            that can be told from clutter.

        Returns
        -------
        Tracker
            Itself.

        Raises
        ------
        ValueError
            If the table does not fit, or says too little; the text says what is missing.
        """
        columns = columns_of(detections)
        config = beyond_any_range(self._parameters.config(columns, blank=True))
        reports: dict[int, list[tuple[int, Detections]]] = {}
        for index, report in reports_of(columns, config):
            reports.setdefault(index, []).append((report.stamp_ns, report.detections))
        found, timed, faults = {}, {}, []
        for index, name in enumerate(each.name for each in config.inputs):
            try:
                if index not in reports:
                    raise TuningError("no detections")
                plots = limit_plots(plots_of(reports[index]))
                found[name], timed[name] = findings(plots), plots.timed
            except TuningError as error:
                faults.append(f"{name}: {error}")
        if faults:
            raise TuningError("; ".join(faults))
        self._parameters = self._parameters.with_findings(found, timed, columns)
        return self

    def track(self, detections: Table) -> Tracks:
        """Track a whole recording.

        Parameters
        ----------
        detections : table
            In any order of time.

        Returns
        -------
        Tracks
            Ordered by time.

        Warns
        -----
        UserWarning
            Of detections that are not used, or do not look as the parameters say.
        """
        columns = columns_of(detections)
        config = self._parameters.config(columns)
        run = _Run(config)
        for radar, report in reports_of(columns, config):
            run.add(radar, report)
        found = run.finish()
        self._told(run)
        return found

    def update(
        self, time: float, detections: Table | None = None, radar: str | None = None
    ) -> Tracks:
        """Take in one report of one radar; reports come in the order of time.

        Parameters
        ----------
        time : float
            Of the report: seconds, or a date.
        detections : table or None
            Without ``time``, but for times of their own, and without ``radar``; those of the first
            report say which columns there are. None if nothing was detected.
        radar : str or None
            Needed with several radars.

        Returns
        -------
        Tracks
            Those that are due: a scan is complete when all radars have reported it, or a later one.
        """
        columns = {} if detections is None else columns_of(detections)
        stamp_ns = int(stamps_ns({TIME: _column(time)})[0])
        if self._run is None:
            if not columns:
                # Which columns there are is not known, nor is there anything to track.
                return self._nothing()
            self._run = _Run(self._parameters.config(columns))
        config = self._run.config
        index = _index_of(radar, [each.name for each in config.inputs])
        self._run.add(index, report_of(stamp_ns, columns, config, index))
        return self._run.take()

    def flush(self) -> Tracks:
        """End the run: return all estimates that are held back. The next `update` begins another.

        Warns
        -----
        UserWarning
            As of `track`.
        """
        run = self._run
        if run is None:
            return self._nothing()
        self._run = None
        found = run.finish()
        self._told(run)
        return found

    def _nothing(self) -> Tracks:
        """Return tables without rows."""
        names = self._parameters.config(blank=True).values["classes"]
        return Tracks(table_of([], names), table_of([], names))

    def _told(self, run: _Run) -> None:
        self.dropped += run.tally.dropped
        for warning in run.warnings():
            warnings.warn(warning, stacklevel=3)


def _column(value: Any) -> Column:
    return columns_of({TIME: [value]})[TIME]


def _index_of(radar: str | None, names: list[str]) -> int:
    """Return the index of a radar by its name; the only one needs none."""
    if radar is None and len(names) == 1:
        return 0
    if radar not in names:
        raise ValueError(f"radar: {radar!r} given, must be one of {', '.join(names)}")
    return names.index(radar)


class _Run:
    """A pass of the pipeline, and what was noticed in it."""

    def __init__(self, config: TrackerConfig) -> None:
        self.config = config
        self.tally = Tally(config)
        self._feed = Feed(config, self.tally)
        self._filtered: list[Estimates] = []
        self._smoothed: list[Estimates] = []

    def add(self, radar: int, report: Report) -> None:
        """Take in a report."""
        self._keep(self._feed.report(radar, report) or ())

    def take(self) -> Tracks:
        """Return the estimates since the last call."""
        names = [kind.name for kind in self.config.model.modes.classes]
        found = Tracks(table_of(self._filtered, names), table_of(self._smoothed, names))
        self._filtered, self._smoothed = [], []
        return found

    def finish(self) -> Tracks:
        """End the run and return the estimates since the last call of `take`."""
        self._keep(self._feed.flush())
        return self.take()

    def warnings(self) -> Iterable[str]:
        """Yield what was noticed, each once."""
        used, dropped = self.tally.used, self.tally.dropped
        if used.lost:
            reasons = ", ".join(f"{reason} {count}" for reason, count in dropped.items())
            yield f"{used.lost.total()} of {used.offered} detections were not used: {reasons}"
        for radar, text in self.tally.about_radars():
            yield f"{self.config.inputs[radar].name}: {text}"
        yield from self.tally.about_targets()

    def _keep(self, events: Iterable[Event]) -> None:
        for event in events:
            if isinstance(event, RunEnded):
                self._smoothed += event.smoothed
                continue
            self.tally.stepped(event)
            self._filtered += event.step.filtered
            self._smoothed += event.step.smoothed
