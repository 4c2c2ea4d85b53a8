"""Which tracks are reported: tentative, confirmed and coasting ones.

A track is confirmed when its existence probability passes one threshold, and stays reported until
it falls below a lower one. A confirmed track that the last scan missed is coasting. A tentative one
is not reported by the filter.

Where no radar can see a target, nothing speaks against its existence, and its probability falls by
survival alone. A track that was not detected for longer than a limit is not reported there. The
filter goes on with it, so that it has its number again when it comes out of a blind sector.

Where radars have maps of clutter, a track is not confirmed if it is probably at rest: it is part of
the map soon, and until then it would be reported in vain. Among reflectors that is likely until its
velocity tells that it moves. Alone at sea it is reported until its velocity tells that it rests.

The thresholds are those of a `reporting_rule`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
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
# A scan that misses a target with a larger probability says nothing about it.
UNSEEN = 0.98
# A target that no antenna has passed for so many intervals, or turns, is coasting.
PATIENCE = 1.5
# Where radars have maps of clutter, a track that is at rest with a larger probability than the
# first is not confirmed, and one with a larger than the second no longer is. A half knows nothing.
STATIONARY, SURELY_STATIONARY = 0.85, 0.9
# Scans that are less than this share of a turn apart may be of the same pass of the antenna.
SAME_TURN = 0.5
# Bound of stored counts and factors.
MOST = 1e18


def missed_by_all(found: Estimates, scan: Scan, model: TrackerModel) -> FloatArray:
    """Return the probability that no radar of a scan detects each target, shape (T,).

    It is that of the target's class, at the target's place, and for radars where they are then.
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

    It is 0 where a radar has no map of clutter, or keeps targets that are at rest. Before a
    velocity is known it is a half where nothing else answers, see `stationary`, and more among
    reflectors: the odds are divided by the probability that the neighbourhood is not one of them.
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
    """Return how probably each target's neighbourhood is one of reflectors to all radars, (T,).

    Only radars that see the place count; 0 where none does. The cells of a radar that moves are
    of the world, wherever it is.
    """
    about = [
        radar.neighbourhood_density(radar.measure(found.state), found.position)
        for radar in model.radars
    ]
    least = np.min(about, axis=0)
    return probability_among_reflectors(np.where(np.isinf(least), 0.0, least))


class Records(NamedTuple):
    """What is known of each track that is not yet gone, confirmed or not.

    Parameters
    ----------
    label : int array of shape (T,)
        Ascending.
    stamp_ns, detected_ns : int arrays of shape (T,)
        Of the last scan that touched it, and of the last one that detected it.
    existence : array of shape (T,)
        Existence probability after the former.
    state : int array of shape (T,)
        `TENTATIVE`, `CONFIRMED` or `COASTING`.
    expected, missed : arrays of shape (T,)
        Expected and actual number of scans without a detection since it was confirmed.
    factor : array of shape (T,)
        Of the odds of existence: the correction for the misses since the last detection.
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
        """Return the records of no tracks."""
        return Records.new(np.zeros(0, dtype=np.int64), 0, np.zeros(0))

    @staticmethod
    def new(label: IntArray, stamp_ns: int, existence: FloatArray) -> Records:
        """Return the records of tracks that begin."""
        size = len(label)
        stamps = np.full(size, stamp_ns, dtype=np.int64)
        tentative, none = np.full(size, TENTATIVE), np.zeros(size)
        return Records(label, stamps, stamps, existence, tentative, none, none, np.ones(size))

    def take(self, rows: IntArray) -> Records:
        """Return the records of these rows."""
        columns: list[Any] = [column[rows] for column in self]
        return Records(*columns)

    def joined(self, other: Records) -> Records:
        """Return the records of both, by ascending label."""
        columns: list[Any] = [np.concatenate(pair) for pair in zip(self, other, strict=True)]
        return Records(*columns).take(np.argsort(columns[0], kind="stable"))

    def updated(self, rows: IntArray, by: Records) -> Records:
        """Return the records with these rows replaced."""
        columns: list[Any] = [column.copy() for column in self]
        for column, other in zip(columns, by, strict=True):
            column[rows] = other
        return Records(*columns)


class Noted(NamedTuple):
    """Stamps, labels and states of filtered estimates that may still be smoothed, each (T,)."""

    stamp_ns: Annotated[IntArray, integers("T", 0, MOST_STAMP_NS)]
    label: Annotated[IntArray, integers("T", 0)]
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]

    def at(self, stamp_ns: int) -> Noted:
        """Return those of a stamp."""
        return Noted(*(column[self.stamp_ns == stamp_ns] for column in self))

    def since(self, stamp_ns: int) -> Noted:
        """Return those from a stamp on."""
        return Noted(*(column[self.stamp_ns >= stamp_ns] for column in self))


class TrackStates:
    """The state of every track, and so which tracks are reported.

    Labels are as in the estimates of `Extraction`: the track's origin plus one.

    Parameters
    ----------
    rule : ReportingRule
    """

    def __init__(self, rule: ReportingRule) -> None:
        self.rule = rule
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._records = Records.of_none()
        self._noted = Noted(*np.zeros((3, 0), dtype=np.int64))

    def filtered(
        self,
        found: Estimates,
        touched: IntArray,
        held_ns: Collection[int],
        scan: Scan,
        model: TrackerModel,
    ) -> Estimates:
        """Return the estimates of a scan that are reported, with their states.

        Parameters
        ----------
        found : Estimates
            All with an existence probability above `ReportingRule.least`.
        touched : int array
            Origins that the scan touched.
        held_ns : collection of int
            Stamps of earlier scans whose tracks no later one has touched.
        scan : Scan
        model : TrackerModel
        """
        if not self.rule.labelled:
            return found
        place = np.argsort(found.track_id, kind="stable")
        labelled = place[found.track_id[place] > 0]
        records = self._next(found.take(labelled), scan, model)
        gone = np.isin(self._records.label - 1, touched)
        gone |= ~np.isin(self._records.stamp_ns, list(held_ns))
        self._records = self._records.take(np.flatnonzero(~gone)).joined(records)
        state = np.full(len(found), CONFIRMED)
        state[found.track_id == 0] = np.where(
            found.weight[found.track_id == 0] > self.rule.delete.min(), CONFIRMED, TENTATIVE
        )
        state[labelled] = records.state
        return replace(found, track_state=state).take(np.flatnonzero(state != TENTATIVE))

    def _next(self, found: Estimates, scan: Scan, model: TrackerModel) -> Records:
        """Return the records of the tracks that a scan found, by ascending label."""
        label, weight = found.track_id, found.weight
        before, known = self._before(found)
        missable = missed_by_all(found, scan, model)
        seen = known & (missable < UNSEEN)
        # The odds of a target that a scan detects rise, and of one that it misses they fall.
        survived = before.existence * _survival(found, before.stamp_ns, model)
        lower = _odds(weight) < _odds(survived)
        # At the edge of a slice a target is in one of two, and not missed by the other.
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
        return new.updated(np.flatnonzero(known), records.take(place[known])), known

    def note(self, published: Estimates) -> None:
        """Keep the states of filtered estimates for the smoothed ones of their stamp."""
        stamp_ns = np.full(len(published), published.stamp_ns)
        new = Noted(stamp_ns, published.track_id, published.track_state)
        self._noted = Noted(*map(np.concatenate, zip(self._noted, new, strict=True)))

    def forget_before(self, stamp_ns: int) -> None:
        """Forget the states of stamps that have been smoothed."""
        self._noted = self._noted.since(stamp_ns)

    def smoothed(self, found: Estimates) -> Estimates:
        """Return the smoothed estimates that are reported, with their states.

        A target is reported if its track was or became confirmed between the stamp and the last
        scan, and is so back to where it begins to exist. Its state is the filter's at the stamp,
        and so tentative before it was confirmed.
        """
        if not self.rule.labelled:
            return found
        confirmed = self._records.label[self._records.state != TENTATIVE]
        ever = np.concatenate([confirmed, self._noted.since(found.stamp_ns).label])
        kept = np.isin(found.track_id, ever) | (found.track_id == 0)
        kept &= found.weight >= self.rule.delete[found.class_id]
        found = found.take(np.flatnonzero(kept))
        _, label, state = self._noted.at(found.stamp_ns)
        states = dict(zip(label.tolist(), state.tolist(), strict=True))
        known = [states.get(n, TENTATIVE if n else CONFIRMED) for n in found.track_id.tolist()]
        return replace(found, track_state=np.array(known, dtype=np.int64))

    def save_state(self) -> dict[str, Any]:
        """Return the states, for `load_state`."""
        return {"records": self._records, "noted": self._noted}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Return to states that were saved."""
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
            If they are none that the tracker could have stored.
        """
        self._records = from_snapshot(Records, snapshot, "tracks", {})
        self._noted = from_snapshot(Noted, snapshot, "noted", {})


def _odds(probability: FloatArray) -> FloatArray:
    """Return the odds of probabilities, finite for those that are 1 or more."""
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
