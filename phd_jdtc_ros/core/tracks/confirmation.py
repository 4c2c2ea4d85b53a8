"""Track confirmation and deletion: tentative, confirmed and coasting tracks.

A track is confirmed when its existence probability exceeds one threshold, and stays reported until
it falls below a lower one. A confirmed track that the last scan missed is coasting. The filter does
not report tentative tracks.

Outside all coverage nothing lowers a target's existence probability except the survival
probability. A track without coverage is no longer reported once its last detection is older than a
limit. The filter keeps it, so that it has the same number when it leaves a blind sector.

With clutter maps, a track that is probably stationary is not confirmed: the map will soon contain
it. Among fixed clutter a track counts as stationary until its velocity shows motion. Alone at sea
it is reported until its velocity shows that it is stationary.

The thresholds come from `reporting_rule`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray, contains
from ..clutter.neighbourhood import probability_among_reflectors
from ..models import stationary
from ..models.amplitude_model import Band
from ..models.tracker_model import TrackerModel
from ..snapshot import (
    MASS_SLACK,
    MOST_STAMP_NS,
    Snapshot,
    floats,
    from_snapshot,
    integers,
    to_snapshot,
)
from ..types import COASTING, CONFIRMED, TENTATIVE, Estimates, Scan
from .reporting_rule import LEAST, ReportingRule, slowest_s

BoolArray = npt.NDArray[np.bool_]
# A scan with a larger probability of a missed detection does not count as a miss.
UNSEEN = 0.98
# Intervals or turns without coverage after which a track is coasting.
PATIENCE = 1.5
# With clutter maps: largest probability of being stationary with which a track is confirmed, and
# with which it stays confirmed. The probability is one half if nothing is known.
STATIONARY, SURELY_STATIONARY = 0.85, 0.9
# Scans less than this share of a turn apart may belong to the same pass of the antenna.
SAME_TURN = 0.5
# Upper bound of counts and factors in a snapshot.
MOST = 1e18


def missed_by_all(found: Estimates, scan: Scan, model: TrackerModel) -> FloatArray:
    """Return the probability that no radar of a scan detects each target, shape (T,).

    It depends on the target's class and position, and on the radars' poses at the scan.
    """
    modes, missed = model.modes, np.ones(len(found))
    mode = np.searchsorted(modes.class_of, found.class_id)
    for report in model.reports(scan):
        sensor = report.sensor
        measured = sensor.measure(found.state)
        nothing = np.zeros(len(found))
        detected = Band().detection_probability(mode, nothing, measured, sensor, modes)
        missed *= 1.0 - sensor.missable(measured, report.detections.coverage) * detected
    return missed


def stationary_probability(found: Estimates, model: TrackerModel) -> FloatArray:
    """Return the probability that each target is stationary, and so clutter to all radars, (T,).

    It is 0 if a radar has no clutter map, or tracks stationary targets. While the velocity is
    unknown it is one half away from fixed clutter, see `stationary`, and larger among fixed
    clutter: the odds are divided by the probability that the neighbourhood has none.
    """
    bound = stationary.stationary_speed(model.radars)
    if bound == 0.0:
        return np.zeros(len(found))
    axes = list(found.space.velocity)
    covariance = found.covariance[:, axes][:, :, axes]
    slower = stationary.slower(found.velocity, covariance, bound)
    alone = model.detection_births.stationary(slower, bound)
    return stationary.among_reflectors(alone, _among_reflectors(found, model))


def _among_reflectors(found: Estimates, model: TrackerModel) -> FloatArray:
    """Return the probability that all radars have fixed clutter around each target, (T,).

    Only radars that see the place count; 0 if none does. The cells of a moving radar are fixed in
    the world.
    """
    about = [
        radar.neighbourhood_density(radar.measure(found.state), found.position)
        for radar in model.radars
    ]
    least = np.min(about, axis=0)
    return probability_among_reflectors(np.where(np.isinf(least), 0.0, least))


class Records(NamedTuple):
    """Confirmation state of each live track, confirmed or not.

    Parameters
    ----------
    label : int array of shape (T,)
        Ascending.
    stamp_ns, detected_ns : int arrays of shape (T,)
        Stamps of the last scan that swept the track, and of its last detection.
    existence : array of shape (T,)
        Existence probability at `stamp_ns`.
    state : int array of shape (T,)
        `TENTATIVE`, `CONFIRMED` or `COASTING`.
    expected, missed : arrays of shape (T,)
        Expected and actual number of missed detections since confirmation.
    factor : array of shape (T,)
        Correction of the odds of existence for the misses since the last detection.
    """

    label: Annotated[IntArray, integers("T", 1, ascending=True)]
    stamp_ns: Annotated[IntArray, integers("T", 0, MOST_STAMP_NS)]
    detected_ns: Annotated[IntArray, integers("T", 0, MOST_STAMP_NS)]
    existence: Annotated[FloatArray, floats("T", 0.0, MASS_SLACK)]
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]
    expected: Annotated[FloatArray, floats("T", 0.0, MOST)]
    missed: Annotated[FloatArray, floats("T", 0.0, MOST)]
    factor: Annotated[FloatArray, floats("T", 0.0, MOST)]

    @staticmethod
    def of_none() -> Records:
        """Return a table without tracks."""
        return Records.new(np.zeros(0, dtype=np.int64), 0, np.zeros(0))

    @staticmethod
    def new(label: IntArray, stamp_ns: int, existence: FloatArray) -> Records:
        """Return the records of new tracks."""
        size = len(label)
        stamps = np.full(size, stamp_ns, dtype=np.int64)
        tentative, none = np.full(size, TENTATIVE), np.zeros(size)
        return Records(label, stamps, stamps, existence, tentative, none, none, np.ones(size))

    def take(self, rows: IntArray) -> Records:
        """Return the records of these rows."""
        columns: list[Any] = [column[rows] for column in self]
        return Records(*columns)

    def merge(self, other: Records) -> Records:
        """Return the records of both, by ascending label."""
        columns: list[Any] = [np.concatenate(pair) for pair in zip(self, other, strict=True)]
        return Records(*columns).take(np.argsort(columns[0], kind="stable"))

    def replace_rows(self, rows: IntArray, by: Records) -> Records:
        """Return the records with these rows replaced."""
        columns: list[Any] = [column.copy() for column in self]
        for column, other in zip(columns, by, strict=True):
            column[rows] = other
        return Records(*columns)


class PastStates(NamedTuple):
    """States of filtered tracks whose stamps may still be smoothed; all columns (T,)."""

    stamp_ns: Annotated[IntArray, integers("T", 0, MOST_STAMP_NS)]
    label: Annotated[IntArray, integers("T", 0)]
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]

    def at(self, stamp_ns: int) -> PastStates:
        """Return the rows of a stamp."""
        return PastStates(*(column[self.stamp_ns == stamp_ns] for column in self))

    def since(self, stamp_ns: int) -> PastStates:
        """Return the rows from a stamp on."""
        return PastStates(*(column[self.stamp_ns >= stamp_ns] for column in self))


class TrackStates:
    """Confirms and deletes tracks, and selects the reported ones.

    Labels are those of the engines' estimates: the target's label plus one.
    """

    def __init__(self, rule: ReportingRule) -> None:
        self.rule = rule
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._records = Records.of_none()
        self._noted = PastStates(*np.zeros((3, 0), dtype=np.int64))

    def report_filtered(
        self,
        found: Estimates,
        touched: IntArray,
        held_ns: Collection[int],
        scan: Scan,
        model: TrackerModel,
    ) -> Estimates:
        """Return the reported estimates of a scan, with their states.

        Parameters
        ----------
        found : Estimates
            All with an existence probability above `ReportingRule.least`.
        touched : int array
            Labels of the targets that the scan swept, ascending.
        held_ns : collection of int
            Stamps of earlier scans with tracks that no later scan has swept.
        scan : Scan
        model : TrackerModel
        """
        if not self.rule.labelled:
            return found
        place = np.argsort(found.track_id, kind="stable")
        labelled = place[found.track_id[place] > 0]
        records = self._next(found.take(labelled), scan, model)
        gone = contains(touched, self._records.label - 1)
        gone |= ~contains(np.array(sorted(held_ns), dtype=np.int64), self._records.stamp_ns)
        self._records = self._records.take(np.flatnonzero(~gone)).merge(records)
        state = np.full(len(found), CONFIRMED)
        state[found.track_id == 0] = np.where(
            found.weight[found.track_id == 0] > self.rule.delete.min(), CONFIRMED, TENTATIVE
        )
        state[labelled] = records.state
        return replace(found, track_state=state).take(np.flatnonzero(state != TENTATIVE))

    def _next(self, found: Estimates, scan: Scan, model: TrackerModel) -> Records:
        """Return the records of a scan's tracks, by ascending label."""
        label, weight = found.track_id, found.weight
        before, known = self._before(found)
        missable = missed_by_all(found, scan, model)
        seen = known & (missable < UNSEEN)
        # A detection raises the odds of existence, and a miss lowers them.
        survived = before.existence * _survival(found, before.stamp_ns, model)
        lower = _odds(weight) < _odds(survived)
        # A target at the edge of a slice may be in either of two: the other one is not a miss.
        same_turn = scan.stamp_ns - before.detected_ns < SAME_TURN * 1e9 * _shortest_turn_s(model)
        missed = seen & lower & ~same_turn
        detected = ~known | (seen & ~lower)
        counted = (missed | detected) & (before.state != TENTATIVE)
        delete = self.rule.delete[found.class_id]
        prior = self.rule.record_weight[found.class_id]
        ratio = (1.0 + before.missed / prior) / (1.0 + before.expected / prior)
        factor = np.where(missed, before.factor * ratio, before.factor)
        factor[detected | np.isinf(prior)] = 1.0
        corrected = _odds(weight) * factor
        corrected = np.where(factor == 1.0, weight, corrected / (1.0 + corrected))
        detected_ns = np.where(detected, scan.stamp_ns, before.detected_ns)
        since_ns = scan.stamp_ns - detected_ns
        long_ago = since_ns > PATIENCE * 1e9 * slowest_s(model)
        lowest = np.where(long_ago & ~seen, self.rule.hidden[found.class_id], delete)
        kept = np.where(
            before.state == TENTATIVE,
            weight > self.rule.confirm[found.class_id],
            (corrected >= lowest) & (weight >= np.minimum(LEAST, delete)),
        )
        kept &= detected | seen | (since_ns <= 1e9 * self.rule.coasting_s)
        bound = np.where(before.state == TENTATIVE, STATIONARY, SURELY_STATIONARY)
        kept &= stationary_probability(found, model) <= bound
        coasting = missed | long_ago | (~detected & (before.state == COASTING))
        return Records(
            label=label,
            stamp_ns=np.full(len(label), scan.stamp_ns),
            detected_ns=detected_ns,
            existence=weight,
            state=np.where(kept, np.where(coasting, COASTING, CONFIRMED), TENTATIVE),
            expected=np.where(counted, before.expected + missable, before.expected),
            missed=before.missed + (counted & missed),
            factor=factor,
        )

    def _before(self, found: Estimates) -> tuple[Records, BoolArray]:
        """Return the record of each track before the scan, and whether there was one."""
        records = self._records
        place = np.searchsorted(records.label, found.track_id)
        known = np.zeros(len(found), dtype=np.bool_)
        inside = place < len(records.label)
        known[inside] = records.label[place[inside]] == found.track_id[inside]
        new = Records.new(found.track_id, found.stamp_ns, found.weight)
        return new.replace_rows(np.flatnonzero(known), records.take(place[known])), known

    def note(self, published: Estimates) -> None:
        """Store the states of filtered estimates for the smoothed ones of their stamp."""
        stamp_ns = np.full(len(published), published.stamp_ns)
        new = PastStates(stamp_ns, published.track_id, published.track_state)
        self._noted = PastStates(*map(np.concatenate, zip(self._noted, new, strict=True)))

    def forget_before(self, stamp_ns: int) -> None:
        """Forget the states of stamps that have been smoothed."""
        self._noted = self._noted.since(stamp_ns)

    def report_smoothed(self, found: Estimates) -> Estimates:
        """Return the reported smoothed estimates, with their states.

        A target is reported if its track was confirmed at any time between the stamp and the last
        scan, and the report extends back to the scan in which the track began. Its state is the
        filter's at the stamp: tentative before the confirmation.
        """
        if not self.rule.labelled:
            return found
        confirmed = self._records.label[self._records.state != TENTATIVE]
        ever = np.concatenate([confirmed, self._noted.since(found.stamp_ns).label])
        kept = contains(np.sort(ever), found.track_id) | (found.track_id == 0)
        kept &= found.weight >= self.rule.delete[found.class_id]
        found = found.take(np.flatnonzero(kept))
        _, label, state = self._noted.at(found.stamp_ns)
        states = dict(zip(label.tolist(), state.tolist(), strict=True))
        known = [states.get(n, TENTATIVE if n else CONFIRMED) for n in found.track_id.tolist()]
        return replace(found, track_state=np.array(known, dtype=np.int64))

    def save_state(self) -> dict[str, Any]:
        """Return the tracks' states, for `load_state`."""
        return {"records": self._records, "noted": self._noted}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Restore saved states."""
        self._records, self._noted = state["records"], state["noted"]

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the states in a snapshot."""
        to_snapshot(self._records, snapshot, "tracks")
        to_snapshot(self._noted, snapshot, "noted")

    def from_snapshot(self, snapshot: Snapshot) -> None:
        """Restore the states from a snapshot.

        Raises
        ------
        ValueError
            If the tracker cannot have stored these values.
        """
        self._records = from_snapshot(Records, snapshot, "tracks", {})
        self._noted = from_snapshot(PastStates, snapshot, "noted", {})


def _odds(probability: FloatArray) -> FloatArray:
    """Return the odds of probabilities; finite for probabilities of 1 or more."""
    return probability / np.maximum(1.0 - probability, np.finfo(float).eps)


def _survival(found: Estimates, since_ns: IntArray, model: TrackerModel) -> FloatArray:
    """Return the probability that each target has survived since an earlier stamp, shape (T,)."""
    nominal = np.array([kind.survival_probability for kind in model.modes.classes])
    intervals = (found.stamp_ns - since_ns) * 1e-9 / model.modes.interval_s
    survival: FloatArray = nominal[found.class_id] ** intervals
    return survival


def _shortest_turn_s(model: TrackerModel) -> float:
    """Return the shortest turn of an antenna, seconds; 0 if none turns."""
    return min((r.rotation_s for r in model.radars if r.rotation_s), default=0.0)
