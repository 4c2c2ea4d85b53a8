# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""An engine whose rows are no particles: one for each origin, with the scan that touched it."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from sweep import configuration

from phd_jdtc_ros.core import window_snapshot
from phd_jdtc_ros.core.backward import smoothed_sets
from phd_jdtc_ros.core.confirmation import ReportingRule
from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.fixed_lag import FixedLagEngine
from phd_jdtc_ros.core.forward import Filtered, ForwardFilter
from phd_jdtc_ros.core.reporting import Schedule, chosen
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.touch import parted
from phd_jdtc_ros.core.types import Coverage, Detections, Estimates, Scan
from phd_jdtc_ros.core.window import Entry, Extents

MODEL = configuration().model
SECOND = 1_000_000_000
# Four targets 50 km away: to the east, north, west and south.
PLACES = 50e3 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
QUARTER = 0.5 * np.pi


@dataclass(frozen=True)
class Marks:
    """One row for each origin, with the index of the latest scan known to have touched it."""

    origin: np.ndarray
    mark: np.ndarray

    @property
    def label(self):
        return self.origin

    def __len__(self):
        return len(self.origin)

    def take(self, rows):
        return Marks(self.origin[rows], self.mark[rows])

    def class_mass(self, class_of, classes, rows=None):
        return np.full(classes, (len(self) if rows is None else len(rows)) / classes)

    def extents(self, space):
        none = np.zeros(len(self))
        place = PLACES[self.origin]
        return Extents(self.origin, np.arange(len(self)), place, 0.0 * place, none, none)


class MarkFilter(ForwardFilter):
    def step(self, scan, linked):
        self._interval(scan)
        touched, others = parted(self.current, scan, self.model, labelled=True)
        origin = np.sort(np.concatenate([np.arange(0), *(rows.origin for rows in touched)]))
        if not self.current:
            origin = np.arange(len(PLACES))
        stored = Marks(origin, np.full(len(origin), float(self._scan_index)))
        earlier = np.concatenate([np.arange(0), *(rows.origin for rows in touched)])
        link = np.searchsorted(origin, earlier) if linked and touched else None
        entry = Entry(scan.stamp_ns, stored, tuple(rows.source for rows in touched), link)
        self._keep(entry, others)
        return Filtered(stored, entry, tuple(rows.entry for rows in touched))


class MarkEngine(FixedLagEngine):
    def _extract(self, stored, stamp_ns, lag, threshold):
        count, modes = len(stored), self.forward.model.modes
        state = np.zeros((count, len(modes.space)))
        state[:, list(modes.space.position)] = PLACES[stored.origin]
        estimates = Estimates(
            stamp_ns=stamp_ns,
            lag=lag,
            state=state,
            covariance=np.zeros((count, len(modes.space), len(modes.space))),
            weight=stored.mark + 1.0,
            class_probability=np.full((count, len(modes.classes)), 1.0 / len(modes.classes)),
            class_id=np.zeros(count, dtype=np.int64),
            track_id=stored.origin + 1,
            space=modes.space,
        )
        return chosen(estimates, np.flatnonzero(estimates.weight > threshold))

    def _backward(self, window):
        return smoothed_sets(window, lambda later, link: later.mark[link], self._heard)

    @staticmethod
    def _heard(stored, told):
        mark = stored.mark.copy()
        for part in told:
            mark[slice(None) if part.rows is None else part.rows] = part.message[part.part]
        return Marks(stored.origin, mark)

    def _figures(self, step):
        return {"touched": sum(len(entry.stored) for entry in step.earlier)}

    def _put_entry(self, held, name, entry):
        window_snapshot.put_sources(held, name, entry)
        held.arrays[f"{name}.origin"] = entry.stored.origin
        held.arrays[f"{name}.mark"] = entry.stored.mark
        if entry.link is not None:
            held.arrays[f"{name}.link"] = entry.link

    def _take_entry(self, held, name, earlier):
        stamp_ns, sources = window_snapshot.take_sources(held, name, 100)
        stored = Marks(held.array(f"{name}.origin"), held.array(f"{name}.mark"))
        for source in sources:
            if source.stamp_ns in earlier:
                window_snapshot.require_rows_of(name, source, earlier[source.stamp_ns].stored)
        return Entry(stamp_ns, stored, sources, held.arrays.get(f"{name}.link"))


def engine(lag=4, threshold=0.5):
    return MarkEngine(MarkFilter(MODEL), Lag(lag), Schedule(0), rule(threshold))


def rule(confirm, delete=None):
    """Return the rule of thresholds on marks, which are no probabilities; one for both if alone."""
    classes = len(MODEL.modes.classes)
    confirm, delete = (np.full(classes, value) for value in (confirm, delete or confirm))
    return ReportingRule(confirm, delete, delete, np.full(classes, np.inf))


def sector(index):
    """Return the scan of a quarter of a turn, the first one about the east."""
    coverage = Coverage((index % 4 - 0.5) * QUARTER, QUARTER)
    return Scan((index + 1) * SECOND, (Detections(np.zeros((0, 2)), None, coverage=coverage),))


def whole(index):
    """Return the scan of a whole turn."""
    return Scan((index + 1) * SECOND, (Detections(np.zeros((0, 2)), None),))


def run(of, first, last, scan=sector):
    steps = [of.step(scan(index)) for index in range(first, last)]
    return [e for step in steps for e in step.filtered], [e for s in steps for e in s.smoothed]


def stored_and_read(snapshot):
    facts = json.loads(json.dumps(snapshot.facts))
    return Snapshot(snapshot.stamp_ns, dict(snapshot.arrays), facts)


def test_filtered_estimates_are_of_the_last_scan_that_touched_each_target():
    filtered, _ = run(engine(), 0, 9)
    by_track = dict(zip(filtered[-1].track_id, filtered[-1].weight, strict=True))
    # Scan 0 began all four; the antenna then came by the others, one after the other.
    # What is predicted from an earlier scan may have died since.
    assert sorted(by_track.values()) == pytest.approx([6.0, 7.0, 8.0, 9.0], rel=1e-2)
    assert {len(estimates) for estimates in filtered} == {4}


def test_smoothed_estimates_have_heard_of_the_scans_within_the_lag():
    _, smoothed = run(engine(lag=4), 0, 12)
    assert [estimates.stamp_ns for estimates in smoothed] == [n * SECOND for n in range(1, 9)]
    # Each of the four later scans passes another target, and none is known of farther ahead.
    assert sorted(smoothed[0].weight) == [2.0, 3.0, 4.0, 5.0]
    for index, estimates in enumerate(smoothed):
        assert len(estimates) == 4
        assert estimates.weight.max() <= index + 5.0


def test_filtered_estimates_are_of_targets_above_the_threshold():
    filtered, _ = run(engine(threshold=7.5), 0, 9)
    # Of 6, 7, 8 and 9, when their scans touched them.
    assert [len(estimates) for estimates in filtered] == [0, 0, 0, 0, 0, 0, 0, 1, 2]


@pytest.mark.parametrize(
    ("scan", "threshold", "found"), [(sector, 4.5, [1, 2, 3, 4]), (whole, 5.5, [0, 4, 4, 4])]
)
def test_smoothed_estimates_are_of_targets_above_the_threshold(scan, threshold, found):
    # The first ones are of 2, 3, 4 and 5 by sectors, and all of 5 by turns; then of one more.
    _, smoothed = run(engine(threshold=threshold), 0, 8, scan)
    assert [len(estimates) for estimates in smoothed] == found


def test_changed_threshold_is_that_of_the_next_estimates():
    of = engine()
    assert {len(estimates) for estimates in run(of, 0, 9)[0]} == {4}
    of.retune(MODEL, rule(10.5))
    filtered, smoothed = run(of, 9, 11)
    assert len(filtered[-1]) == 4 - 1  # the scan before the last one touched a target of 10
    assert [len(estimates) for estimates in smoothed] == [0, 1]


def test_window_forgets_what_no_stamp_needs():
    of = engine(lag=4)
    run(of, 0, 40)
    assert len(of._window) <= 4 + 4 + 1


def test_restored_engine_goes_on_and_an_interrupted_one_uses_no_number_again():
    first, second = engine(), engine()
    run(first, 0, 7)
    second.restore(stored_and_read(first.snapshot()))
    for one, other in zip(run(first, 7, 12), run(second, 7, 12), strict=True):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours.weight, theirs.weight)
            np.testing.assert_array_equal(ours.track_id, theirs.track_id)
    assert [len(e) for e in first.flush()] == [len(e) for e in second.interrupt()] == [4] * 4
    (after,) = second.step(sector(12)).filtered
    assert sorted(after.track_id) == [5, 6, 7, 8]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda held: held.facts["smoother"].update(stamps_ns=[2, 1]), "stamps_ns: must increase"),
        (lambda held: held.facts["filter"].update(current_ns=[5]), "none of the stored sets"),
        (lambda held: held.facts["stored.1"].update(sizes=[3]), "rows, expected"),
        (lambda held: held.arrays.pop(f"filtered.{7 * SECOND}.weight"), "weight: missing"),
    ],
)
def test_restore_says_what_is_wrong_and_leaves_a_new_engine(change, named):
    of, fresh = engine(), engine()
    run(of, 0, 7)
    held = stored_and_read(of.snapshot())
    change(held)
    with pytest.raises(ValueError, match=named):
        of.restore(held)
    assert run(of, 0, 3)[0][-1].weight.tolist() == run(fresh, 0, 3)[0][-1].weight.tolist()


def test_stamp_that_is_not_later_is_refused():
    of = engine()
    of.step(sector(3))
    with pytest.raises(ValueError, match="not later than"):
        of.step(sector(3))
