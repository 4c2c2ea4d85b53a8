"""The tracker for tables of detections."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.calibration.comparison import Comparison, Monitor
from phd_jdtc_ros.calibration.innovations import InnovationMonitor
from phd_jdtc_ros.calibration.registration.monitor import RegistrationMonitor
from phd_jdtc_ros.calibration.tuning.area import area_of
from phd_jdtc_ros.calibration.tuning.findings import Findings, TuningError, findings
from phd_jdtc_ros.calibration.tuning.plots import limit_plots, plots_of
from phd_jdtc_ros.columns.report_selection import Told
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.intake.input_checks import NOT_IN_RECORDINGS
from phd_jdtc_ros.core.pipeline import Event, RunEnded
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import Detections, Estimates, SelfReports
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.tally import DetectionCounts, Tally

from .parameters import Parameters
from .reports import TIME, everywhere, report_of, reports_of, told_of
from .tables import Column, Columns, Table, columns_of, stamps_ns, table_of


class Tracks(NamedTuple):
    """Estimates of targets, as structured arrays; see `Tracker` for their columns."""

    filtered: Column  # Estimates from the detections up to their time
    # Estimates from later detections within the lag too: more accurate, and delayed by the lag.
    smoothed: Column


class Tracker:
    """Detects, tracks and classifies targets in tables of detections.

    Parameters
    ----------
    parameters : mapping, str, path or None
        The tracker's parameters, by dotted or nested names, see ``docs/parameters.md``. The
        defaults here are one radar, named ``radar``, and one class of targets, ``target``, that may
        appear anywhere. ``interval_s`` and each radar's ``range_std``, ``azimuth_std_deg`` and
        ``max_range``, or for positions ``position_std`` and ``area``, must be given, or estimated
        by `fit`. Without `fit` also set
        ``detection_births.std``, because targets that are several times faster than its
        40 m/s may not be found. A str or a path is a parameter file of the node, with the node's
        defaults.

    Attributes
    ----------
    parameters : dict
        The given and the estimated parameters, by dotted name.
    dropped : Counter
        Numbers of unused detections and reports, by reason.

    Raises
    ------
    ConfigError
        A ValueError with all faults of the parameters.

    Notes
    -----
    Tables of detections are mappings of column to values, data frames, structured arrays or paths
    of CSV files. Their columns are ``time`` (seconds, or dates), ``radar`` (its name; with several
    radars), and either ``range`` and ``azimuth`` (metres; radians counter-clockwise from the
    radar's x axis, or as ``units`` define) or ``x`` and ``y``
    (metres, in the sensor's frame, which is the world's unless ``position`` and ``yaw_deg`` are
    given) or ``lat`` and ``lon`` (degrees; they become x and y about ``world_origin``). Positions
    may have deviations, ``x_std``, ``y_std`` and ``correlation``, or ``position_std`` along both
    axes, and velocities over ground, ``vx`` and ``vy`` (m/s).
    Further columns are named by ``fields``. Columns with the names of its
    parameters (``amplitude``, ``height``, ``code``, ``range_rate`` and so on) are used if present;
    others are ignored.

    Rows of one time and one radar are one scan: targets without a row in it were missed. A scan
    without detections is a row with a time only. With a turning antenna, each detection has an
    individual time, which ``fields.time: time`` declares. Times have a resolution of a microsecond.

    Tables of tracks are structured arrays with a row for each target and time:

    ===================== =================================================================
    ``time``              of the state, seconds
    ``label``             number of the track, from 1; 0 without a label
    ``class``             name of the most probable class
    ``class_probability`` probability of this class
    ``probability``       probability of existence
    ``state``             ``tentative``, ``confirmed`` or ``coasting`` (not detected recently)
    ``x y``               position in the world frame, metres
    ``vx vy``             velocity, metres per second
    ``height``            metres; NaN if unknown
    ``code address``      Mode A code and Mode S address; -1 if unknown
    ``covariance``        of ``x y vx vy``, shape (4, 4)
    ``z vz``              height and climb rate, metres and metres per second; NaN if unknown
    ``covariance_space``  of ``x y z vx vy vz``, shape (6, 6); NaN where the height is unknown
    ===================== =================================================================

    Tables of self-reports (AIS, ADS-B) need a sensor of ``kind: reports``. Their columns are
    ``time`` and ``lat`` and ``lon`` (degrees) or ``x`` and ``y`` (metres in the world),
    and if they are known ``address``, ``speed`` (m/s) and ``course`` (degrees from north) or ``vx``
    and ``vy``, ``heading``, ``std``, ``type`` and ``name``; with several receivers ``receiver``.
    Tables of tracks then have ``source`` (words), ``owned``, ``dark``, ``silent``, ``doubtful``
    (probabilities), ``alone`` (a track of reports alone) and ``reason``.

    Equal detections give equal tracks, in one call of `track`, step by step with `update`, and in
    the live node.
    """

    def __init__(self, parameters: Mapping[str, Any] | str | PathLike[str] | None = None) -> None:
        self._parameters = Parameters.of(parameters)
        self._run: _Run | None = None
        # Stamp and radar of the reports before the first detections, which define the columns.
        self._before_run: list[tuple[int, int]] = []
        self.dropped: Counter[str] = Counter()
        # This raises for invalid values, but not for parameters that are still missing.
        self._parameters.config(incomplete=True)

    def __getstate__(self) -> dict[str, Any]:
        """Return what copies and pickles store; raise `TypeError` in a run, which has no copy."""
        if self._run is not None:
            raise TypeError("Tracker: in a run, cannot be copied or pickled; flush it first")
        return self.__dict__.copy()

    @property
    def parameters(self) -> dict[str, Any]:
        """The given and the estimated parameters, by dotted name."""
        return self._parameters.values()

    def fit(self, detections: Table) -> Tracker:
        """Estimate the missing parameters: noise, detection probability, clutter, revolutions.

        Parameters
        ----------
        detections : table
            Some minutes with a few targets: at least ten scans, and thirty detections of targets
            that can be distinguished from clutter.

        Returns
        -------
        Tracker
            The tracker itself.

        Raises
        ------
        ValueError
            If the table is invalid or insufficient; the message names what is missing.

        Warns
        -----
        UserWarning
            If detections are not used or contradict the parameters, or about targets at rest and
            clutter.
        """
        columns = columns_of(detections)
        text = self._parameters.seem_wrong(columns)
        parameters = self._parameters.with_origin(columns)
        columns = parameters.in_plane(columns)
        parameters = parameters.with_units(columns)
        config = parameters.config(columns, incomplete=True)
        fields, config = config.model.radars, everywhere(config)
        tally = Tally(config)
        reports: dict[int, list[tuple[int, Detections]]] = {}
        counts = [DetectionCounts() for _ in config.inputs]
        checks = config.report_checks()
        for index, report in reports_of(columns, config):
            counts[index].read(len(report.detections), report.dropped)
            noticed = set(checks[index].add(report.detections)) & {*NOT_IN_RECORDINGS}
            used = checks[index].used(report.detections)
            reports.setdefault(index, []).append((report.stamp_ns, used))
            tally.on_anomalies(index, report.anomalies + Counter(noticed))
        about: dict[int, list[str]] = {}
        if text:
            about = {index: [text] for index in range(len(config.inputs))}
            warnings.warn(text, stacklevel=2)
        for index, text in tally.about_radars():
            about.setdefault(index, []).append(text)
            warnings.warn(f"{config.inputs[index].name}: {text}", stacklevel=2)
        for sensor, read in zip(config.inputs, counts, strict=True):
            if read.lost:
                warnings.warn(f"{sensor.name}: {read.unused()}", stacklevel=2)
        found, faults = {}, []
        for index, name in enumerate(each.name for each in config.inputs):
            try:
                if index not in reports:
                    raise TuningError("no detections")
                found[name] = _findings(reports[index], fields[index])
            except TuningError as error:
                reason = counts[index].fault()
                reasons = [str(error), *([reason] if reason else ()), *about.get(index, ())]
                faults.append(f"{name}: {'; '.join(reasons)}")
        if faults:
            raise TuningError("; ".join(faults))
        for text in parameters.remarks(found):
            warnings.warn(text, stacklevel=2)
        self._parameters = parameters.with_findings(found, columns)
        return self

    def track(self, detections: Table | None, reports: Table | None = None) -> Tracks:
        """Track a whole recording.

        Parameters
        ----------
        detections : table or None
            Detections in any order of time; None for a tracker of self-reports alone.
        reports : table or None
            What transmitters report of themselves, in any order of time; see `Tracker`.

        Returns
        -------
        Tracks
            Tracks in the order of time.

        Warns
        -----
        UserWarning
            If detections are not used or contradict the parameters.
        """
        columns = {} if detections is None else columns_of(detections)
        if text := self._parameters.seem_wrong(columns):
            warnings.warn(text, stacklevel=2)
        columns = self._parameters.in_plane(columns)
        config = self._parameters.config(columns)
        run = _Run(config)
        if reports is not None:
            run.tell(columns_of(reports))
        for radar, report in reports_of(columns, config) if columns else ():
            run.add(radar, report)
        found = run.finish()
        self._warn(run)
        return found

    def update(
        self,
        time: float,
        detections: Table | None = None,
        radar: str | None = None,
        reports: Table | None = None,
    ) -> Tracks:
        """Process one report of one radar; reports must come in the order of time.

        Parameters
        ----------
        time : float
            Time of the report: seconds, or a date.
        detections : table or None
            Columns other than ``radar``, with ``time`` only if detections have individual times.
            The first report defines the columns. None if there are no detections.
        radar : str or None
            Required with several radars.
        reports : table or None
            What transmitters have reported of themselves since the last call.

        Returns
        -------
        Tracks
            Estimates that are due: a scan is complete when all radars have reported it, or a later
            one.
        """
        columns = {} if detections is None else columns_of(detections)
        columns = self._parameters.in_plane(columns)
        stamp_ns = int(stamps_ns({TIME: np.atleast_1d(time)})[0])
        run = self._run
        if run is None and columns:
            run = self._run = _Run(self._parameters.config(columns))
            for empty_ns, index in self._before_run:
                run.add(index, report_of(empty_ns, {}, run.config, index))
            self._before_run.clear()
        config = self._parameters.config(incomplete=True) if run is None else run.config
        if not config.inputs:  # Self-reports define no columns
            run = self._run = run or _Run(config)
        index = _index_of(radar, [each.name for each in config.inputs])
        if run is None:
            self._before_run.append((stamp_ns, index))
            return self._empty()
        if reports is not None:
            run.tell(columns_of(reports))
        if config.inputs:
            run.add(index, report_of(stamp_ns, columns, config, index))
        else:
            run.tell_until(stamp_ns)
        return run.take()

    def flush(self) -> Tracks:
        """End the run, and return all pending estimates; the next `update` begins a new run.

        Warns
        -----
        UserWarning
            As in `track`.
        """
        run = self._run
        self._before_run.clear()
        if run is None:
            return self._empty()
        self._run = None
        found = run.finish()
        self._warn(run)
        return found

    def _empty(self) -> Tracks:
        config = self._parameters.config(incomplete=True)
        nothing = table_of([], config.values["classes"], bool(config.receivers))
        return Tracks(nothing, nothing.copy())

    def _warn(self, run: _Run) -> None:
        self.dropped += run.tally.dropped
        for warning in run.warnings():
            warnings.warn(warning, stacklevel=3)


def _findings(reports: list[tuple[int, Detections]], sensor: Sensor) -> Findings:
    """Return the findings of a sensor's reports."""
    if isinstance(sensor, RadarModel):
        rates, field = sensor.range_rate, sensor.visibility
        plots = plots_of(reports, ambiguity=rates.ambiguity if rates else 0.0)
        plots = replace(plots, fov=field.fov.width, min_range=field.min_range)
    else:
        plots = plots_of(reports, places=True)
    part = limit_plots(plots)
    found = findings(part)
    if part.places:
        # A few detections show the noise, but only all of them the area.
        found = replace(found, field=replace(found.field, area=area_of(plots.measurement)))
    return found


def _index_of(radar: str | None, names: list[str]) -> int:
    """Return the index of a radar by its name, which a single radar does not need."""
    if radar is None and len(names) <= 1:
        return 0
    if radar not in names:
        raise ValueError(f"radar: {radar!r} given, must be one of {', '.join(names)}")
    return names.index(radar)


class _Run:
    """A run of the pipeline with the warnings about it."""

    def __init__(self, config: TrackerConfig) -> None:
        self.config, self.tally = config, Tally(config)
        self._innovations = InnovationMonitor(config.model)
        radars = config.model.radars
        # It compares radars with each other, and knows no other sensors.
        compared = len(radars) > 1 and all(isinstance(each, RadarModel) for each in radars)
        self._registration = RegistrationMonitor(config.model) if compared else None
        monitors: list[Monitor] = [self._innovations, *filter(None, [self._registration])]
        self._feed = Feed(config, self.tally, [Comparison(config.model, monitors)])
        self._told: list[tuple[int, SelfReports]] = []
        self._filtered: list[Estimates] = []
        self._smoothed: list[Estimates] = []

    def tell(self, columns: Columns) -> None:
        """Take in self-reports, each of which waits for the reports of radars at its time."""
        for receiver, told in told_of(columns, self.config):
            none = told.reports.take(np.arange(0))
            self._keep(self._feed.self_reports(receiver, partial(Told, none, told.dropped)))
            self._told.append((receiver, told.reports))

    def tell_until(self, stamp_ns: int) -> None:
        """Process the self-reports up to a stamp."""
        waiting = []
        for receiver, told in self._told:
            due, later = np.flatnonzero(told.time_ns <= stamp_ns), told.time_ns > stamp_ns
            if len(due):
                part = partial(Told, told.take(due), Counter())
                self._keep(self._feed.self_reports(receiver, part))
            waiting.append((receiver, told.take(np.flatnonzero(later))))
        self._told = [each for each in waiting if len(each[1])]

    def add(self, radar: int, report: Report) -> None:
        """Process a report."""
        if self._told:
            self.tell_until(report.stamp_ns)
        self._keep(self._feed.report(radar, report) or ())

    def take(self) -> Tracks:
        """Return the estimates since the last call."""
        names = [kind.name for kind in self.config.model.modes.classes]
        told = bool(self.config.receivers)
        parts = (self._filtered, self._smoothed)
        found = Tracks(*(table_of(each, names, told) for each in parts))
        self._filtered, self._smoothed = [], []
        return found

    def finish(self) -> Tracks:
        """End the run, and return the estimates since the last call of `take`."""
        if not self.config.inputs:
            interval_ns = round(self.config.interval_s * 1e9)
            times = [each.time_ns // interval_ns for _, each in self._told]
            for index in np.unique(np.concatenate(times or [np.zeros(0, np.int64)])).tolist():
                self.tell_until((index + 1) * interval_ns)
        self._keep(self._feed.flush())
        return self.take()

    def warnings(self) -> Iterable[str]:
        """Yield each warning once."""
        counts = self.tally.detections
        if counts.lost:
            yield counts.unused(self.tally.dropped)
        yield from (f"{each.name}: silent, without a row" for each in self.tally.silent())
        residuals = [] if self._registration is None else self._registration.mean_residuals()
        for radar, text in self.tally.about_radars(self._innovations.fits(), residuals):
            yield f"{self.config.inputs[radar].name}: {text}"
        yield from self.tally.about_run()

    def _keep(self, events: Iterable[Event]) -> None:
        for event in events:
            self.tally.note_event(event)
            if isinstance(event, RunEnded):
                self._smoothed += event.smoothed
                continue
            self._filtered += event.step.filtered
            self._smoothed += event.step.smoothed
