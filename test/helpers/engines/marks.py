"""An engine whose rows are no particles: one for each row_label, with the scan that swept it."""

from dataclasses import dataclass, field, replace

import numpy as np
from sweep import configuration

from phd_jdtc_ros.core.tracks.reporting_rule import ReportingRule
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.core.window import window_snapshot
from phd_jdtc_ros.core.window.backward_pass import smoothed_sets
from phd_jdtc_ros.core.window.entries import Entry, Extents, UnsweptRows
from phd_jdtc_ros.core.window.forward_filter import Filtered, ForwardFilter
from phd_jdtc_ros.core.window.set_smoother import SetSmoother
from phd_jdtc_ros.core.window.swept import partition_swept

MODEL = configuration().model
# Four targets 50 km away: to the east, north, west and south.
PLACES = 50e3 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


@dataclass(frozen=True)
class Marks:
    """One row for each row_label, with the index of the latest scan known to have swept it."""

    row_label: np.ndarray
    mark: np.ndarray

    @property
    def label(self):
        return self.row_label

    def __len__(self):
        return len(self.row_label)

    def take(self, rows):
        return Marks(self.row_label[rows], self.mark[rows])

    def class_mass(self, class_of, classes, rows=None):
        return np.full(classes, (len(self) if rows is None else len(rows)) / classes)

    def extents(self, space):
        moments = np.zeros((len(self), 6))
        moments[:, :2] = PLACES[self.row_label]
        return Extents(self.row_label, np.arange(len(self)), moments)


@dataclass
class MarkFilter(ForwardFilter):
    """Stores the origins that a scan touches, with its index as their mark."""

    # `begins`, `ends`: dict of row_label to int. Scans that begin an row_label, 0 if it is not
    # named, and that drop it if they touch it.
    begins: dict = field(default_factory=dict)
    ends: dict = field(default_factory=dict)
    noted: float = 0.0  # What a scan adds to the marks of earlier sets whose rows it touches

    def step(self, scan, linked):
        self._interval(scan)
        index = self._scan_index
        swept, others = partition_swept(self.unswept, scan, self.model, labelled=True)
        earlier = np.concatenate([np.arange(0), *(rows.row_label for rows in swept)])
        new = [each for each in range(len(PLACES)) if self.begins.get(each, 0) == index]
        kept = [each for each in earlier.tolist() if self.ends.get(each, index + 1) > index]
        row_label = np.array(sorted([*kept, *new]), dtype=np.int64)
        stored = Marks(row_label, np.full(len(row_label), float(index)))
        link = None
        if linked and swept:
            link = np.where(np.isin(earlier, row_label), np.searchsorted(row_label, earlier), -1)
        entry = Entry(scan.stamp_ns, stored, tuple(rows.source for rows in swept), link)
        noted = {rows.entry.stamp_ns: self._noted(rows) for rows in swept}
        left = [noted.get(rows.entry.stamp_ns, rows.entry) for rows in others]
        self._keep(entry, list(map(UnsweptRows, left, (rows.rows for rows in others))))
        return Filtered(stored, entry, tuple(noted.values()))

    def _noted(self, rows):
        mark = rows.entry.stored.mark.copy()
        mark[slice(None) if rows.rows is None else rows.rows] += self.noted
        return replace(rows.entry, stored=Marks(rows.entry.stored.row_label, mark))


class MarkEngine(SetSmoother):
    def _extract(self, stored, stamp_ns, lag, threshold):
        count, modes = len(stored), self.forward.model.modes
        state = np.zeros((count, len(modes.space)))
        state[:, list(modes.space.position)] = PLACES[stored.row_label]
        estimates = Estimates(
            stamp_ns=stamp_ns,
            lag=lag,
            state=state,
            covariance=np.zeros((count, len(modes.space), len(modes.space))),
            weight=stored.mark + 1.0,
            class_probability=np.full((count, len(modes.classes)), 1.0 / len(modes.classes)),
            class_id=np.zeros(count, dtype=np.int64),
            track_id=stored.row_label + 1,
            space=modes.space,
        )
        return estimates.take(np.flatnonzero(estimates.weight > threshold))

    def _backward(self, window):
        return list(smoothed_sets(window, self._send, self._receive))

    @staticmethod
    def _send(later, link):
        return np.append(later.mark, np.nan)[link]  # nothing of those that were dropped

    @staticmethod
    def _receive(stored, messages):
        mark = stored.mark.copy()
        for part in messages:
            rows = slice(None) if part.rows is None else part.rows
            message = part.content[part.part]
            mark[rows] = np.where(np.isnan(message), mark[rows], message)
        return Marks(stored.row_label, mark)

    def _figures(self, step):
        return {"swept": sum(len(entry.stored) for entry in step.replaced)}

    def _entry_to_snapshot(self, entry, held, name):
        window_snapshot.sources_to_snapshot(entry, held, name)
        held.arrays[f"{name}.origin"] = entry.stored.row_label
        held.arrays[f"{name}.mark"] = entry.stored.mark
        if entry.link is not None:
            held.arrays[f"{name}.link"] = entry.link

    def _entry_from_snapshot(self, held, name, earlier):
        stamp_ns, sources = window_snapshot.sources_from_snapshot(held, name, 100)
        stored = Marks(held.array(f"{name}.origin"), held.array(f"{name}.mark"))
        for source in sources:
            if source.stamp_ns in earlier:
                window_snapshot.require_rows_of(name, source, earlier[source.stamp_ns].stored)
        return Entry(stamp_ns, stored, sources, held.arrays.get(f"{name}.link"))


def rule(confirm, delete=None):
    """Return the rule of thresholds on marks, which are no probabilities; one for both if alone."""
    classes = len(MODEL.modes.classes)
    confirm, delete = (np.full(classes, value) for value in (confirm, delete or confirm))
    return ReportingRule(
        confirm, delete, delete, np.ones(classes, dtype=bool), np.full(classes, np.inf)
    )
