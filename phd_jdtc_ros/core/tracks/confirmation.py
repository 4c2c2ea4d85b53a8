"""Track confirmation and deletion: tentative, confirmed and coasting tracks.

A track is confirmed when its existence probability exceeds one threshold, and stays reported until
it falls below a lower one. A confirmed track that the last scan missed is coasting. The filter does
not report tentative tracks.

Outside all coverage nothing lowers a target's existence probability except the survival
probability. A track without coverage is no longer reported once its last detection is older than a
limit. The filter keeps it, so that it has the same number when it leaves a blind sector.

A target whose most probable class is at rest has a track like any other, but is not reported.

With clutter maps, a track that is probably stationary is not confirmed: the map will soon contain
it. Near fixed clutter, a track is taken as stationary until its velocity shows that it moves. Away
from it, a track is taken as moving until its velocity shows that it is stationary.

The thresholds come from `reporting_rule`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, contains
from ..clutter.neighbourhood import probability_among_reflectors
from ..models import stationary
from ..models.amplitude_model import Band
from ..models.tracker_model import TrackerModel
from ..snapshot import Snapshot, from_snapshot, to_snapshot
from ..types import COASTING, CONFIRMED, TENTATIVE, Estimates, Scan
from .confirmation_records import ConfirmationRecords, NotedStates, PastStates
from .reporting_rule import MIN_EXISTENCE, ReportingRule, slowest_s

# A target that a scan misses with a larger probability than this counts as not covered: neither as
# missed nor as detected.
MAX_MISS_PROBABILITY = 0.98
# Intervals or turns without coverage after which a track is coasting.
PATIENCE = 1.5
# Largest probability of being stationary, with clutter maps, with which a track is confirmed. The
# probability is one half if nothing is known.
MAX_STATIONARY_TO_CONFIRM = 0.85
# Largest probability of being stationary with which a confirmed track stays confirmed.
MAX_STATIONARY_CONFIRMED = 0.9
# Scans less than this share of a turn apart may belong to the same pass of the antenna.
SAME_TURN = 0.5


def missed_by_all(estimates: Estimates, scan: Scan, model: TrackerModel) -> FloatArray:
    """Return the probability that no radar of a scan detects each target, shape (T,).

    It depends on the target's class and position, and on the radars' poses at the scan.
    """
    modes, missed = model.modes, np.ones(len(estimates))
    mode = np.searchsorted(modes.class_of, estimates.class_id)
    for report in model.reports(scan):
        sensor = report.sensor
        measured = sensor.measure(estimates.state)
        detected = sensor.given_detection_probability(measured)
        if detected is None:
            nothing = np.zeros(len(estimates))
            detected = Band().detection_probability(mode, nothing, sensor, modes)
        detected = sensor.learned_detection_probability(detected, measured)
        missed *= 1.0 - sensor.coverage_probability(measured, report.detections.coverage) * detected
    return missed


def stationary_probability(estimates: Estimates, model: TrackerModel) -> FloatArray:
    """Return the probability that each target is stationary, and so clutter to all radars, (T,).

    It is 0 if a radar has no clutter map, or tracks stationary targets. While the velocity is
    unknown it is one half away from fixed clutter, see `stationary`, and larger among fixed
    clutter: the odds are divided by the probability that the neighbourhood has none.
    """
    bound = stationary.stationary_speed(model.radars)
    if bound == 0.0:
        return np.zeros(len(estimates))
    axes = list(estimates.space.velocity)
    covariance = estimates.covariance[:, axes][:, :, axes]
    slower = stationary.probability_slower(estimates.velocity, covariance, bound)
    alone = model.detection_births.stationary(slower, bound)
    return stationary.among_reflectors(alone, _among_reflectors(estimates, model))


def _among_reflectors(estimates: Estimates, model: TrackerModel) -> FloatArray:
    """Return the probability that all radars have fixed clutter around each target, (T,).

    Only radars that see the place count; 0 if none does. The cells of a moving radar are fixed in
    the world.
    """
    excess = [
        radar.neighbourhood_density(radar.measure(estimates.state), estimates.position)
        for radar in model.radars
    ]
    smallest = np.min(excess, axis=0)
    return probability_among_reflectors(np.where(np.isinf(smallest), 0.0, smallest))


class _Detection(NamedTuple):
    """Detection or miss of each track in a scan, arrays of shape (T,)."""

    miss_probability: FloatArray  # Probability that no radar of the scan detects the track
    covered: BoolArray  # Whether the scan can show that the track was missed
    missed: BoolArray
    detected: BoolArray

    @staticmethod
    def of(
        estimates: Estimates,
        before: ConfirmationRecords,
        known: BoolArray,
        scan: Scan,
        model: TrackerModel,
    ) -> _Detection:
        """Return the detections and misses; a detection raises the odds of existence."""
        miss_probability = missed_by_all(estimates, scan, model)
        covered = known & (miss_probability < MAX_MISS_PROBABILITY)
        survived = before.existence * _survival(estimates, before.stamp_ns, model)
        lower = _odds(estimates.weight) < _odds(survived)
        # A target at the edge of a slice may be in either of two: the other one is not a miss.
        turn_ns = 1e9 * _shortest_turn_s(model)
        same_turn = scan.stamp_ns - before.detected_ns < SAME_TURN * turn_ns
        missed = covered & lower & ~same_turn
        return _Detection(miss_probability, covered, missed, ~known | (covered & ~lower))


class TrackStates:
    """Confirms and deletes tracks, and selects the reported ones.

    Labels are those of the engines' estimates: the target's label plus one.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_records", "_noted")

    def __init__(self, rule: ReportingRule) -> None:
        self.rule = rule
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._records = ConfirmationRecords.of_none()
        self._noted = PastStates()

    def report_filtered(
        self,
        estimates: Estimates,
        swept: IntArray,
        unswept_ns: Collection[int],
        scan: Scan,
        model: TrackerModel,
    ) -> Estimates:
        """Return the reported estimates of a scan, with their states.

        Parameters
        ----------
        estimates : Estimates
            All with an existence probability above `ReportingRule.least`.
        swept : int array
            Labels of the targets that the scan swept, ascending.
        unswept_ns : collection of int
            Stamps of earlier scans with tracks that no later scan has swept.
        """
        if not self.rule.labelled:
            return self._of_reported_classes(estimates)
        place = np.argsort(estimates.track_id, kind="stable")
        labelled = place[estimates.track_id[place] > 0]
        records = self._next(estimates.take(labelled), scan, model)
        gone = contains(swept, self._records.label - 1)
        gone |= ~contains(np.array(sorted(unswept_ns), dtype=np.int64), self._records.stamp_ns)
        # A scan of a whole turn leaves none of the earlier records.
        before = self._records.take(np.flatnonzero(~gone)) if not gone.all() else None
        self._records = records if before is None else before.merge(records)
        state = np.where(estimates.weight > self.rule.delete.min(), CONFIRMED, TENTATIVE)
        state[labelled] = records.state
        known = (state != TENTATIVE) & self.rule.reported[estimates.class_id]
        return replace(estimates, track_state=state).take(np.flatnonzero(known))

    def _of_reported_classes(self, estimates: Estimates) -> Estimates:
        reported = self.rule.reported[estimates.class_id]
        return estimates if reported.all() else estimates.take(np.flatnonzero(reported))

    def _next(self, estimates: Estimates, scan: Scan, model: TrackerModel) -> ConfirmationRecords:
        """Return the records of a scan's tracks, by ascending label."""
        before, known = self._before(estimates)
        detection = _Detection.of(estimates, before, known, scan, model)
        tentative, missed = before.state == TENTATIVE, detection.missed
        factor, existence = self._corrected_existence(estimates, before, detection)
        detected_ns = np.where(detection.detected, scan.stamp_ns, before.detected_ns)
        since_ns = scan.stamp_ns - detected_ns
        long_ago = since_ns > PATIENCE * 1e9 * slowest_s(model)
        hidden = long_ago & ~detection.covered
        reported = self._is_reported(estimates, existence, tentative, hidden)
        recent = since_ns <= 1e9 * self.rule.coasting_s
        reported &= detection.detected | detection.covered | recent
        bound = np.where(tentative, MAX_STATIONARY_TO_CONFIRM, MAX_STATIONARY_CONFIRMED)
        reported &= stationary_probability(estimates, model) <= bound
        coasting = missed | long_ago | (~detection.detected & (before.state == COASTING))
        counted = (missed | detection.detected) & ~tentative
        expected = before.expected + detection.miss_probability
        return ConfirmationRecords(
            label=estimates.track_id,
            stamp_ns=np.full(len(estimates), scan.stamp_ns),
            detected_ns=detected_ns,
            existence=estimates.weight,
            state=np.where(reported, np.where(coasting, COASTING, CONFIRMED), TENTATIVE),
            expected=np.where(counted, expected, before.expected),
            missed=before.missed + (counted & missed),
            factor=factor,
        )

    def _corrected_existence(
        self, estimates: Estimates, before: ConfirmationRecords, detection: _Detection
    ) -> tuple[FloatArray, FloatArray]:
        """Return the factor of the odds by each track's own record, and the existence with it."""
        prior = self.rule.record_weight[estimates.class_id]
        ratio = (1.0 + before.missed / prior) / (1.0 + before.expected / prior)
        factor = np.where(detection.missed, before.factor * ratio, before.factor)
        factor[detection.detected | np.isinf(prior)] = 1.0
        corrected = _odds(estimates.weight) * factor
        existence = np.where(factor == 1.0, estimates.weight, corrected / (1.0 + corrected))
        return factor, existence

    def _is_reported(
        self, estimates: Estimates, existence: FloatArray, tentative: BoolArray, hidden: BoolArray
    ) -> BoolArray:
        """Return a mask of the tracks that their existence probability confirms or keeps."""
        rule, kind, weight = self.rule, estimates.class_id, estimates.weight
        delete = rule.delete[kind]
        lowest = np.where(hidden, rule.hidden[kind], delete)
        kept = (existence >= lowest) & (weight >= np.minimum(MIN_EXISTENCE, delete))
        return np.where(tentative, weight > rule.confirm[kind], kept)

    def _before(self, estimates: Estimates) -> tuple[ConfirmationRecords, BoolArray]:
        """Return the record of each track before the scan, and whether there was one."""
        records = self._records
        place = np.searchsorted(records.label, estimates.track_id)
        known = np.zeros(len(estimates), dtype=np.bool_)
        inside = place < len(records.label)
        known[inside] = records.label[place[inside]] == estimates.track_id[inside]
        new = ConfirmationRecords.new(estimates.track_id, estimates.stamp_ns, estimates.weight)
        return new.replace_rows(np.flatnonzero(known), records.take(place[known])), known

    def note(self, published: Estimates) -> None:
        """Store the states of filtered estimates for the smoothed ones of their stamp."""
        self._noted = self._noted.then(published)

    def forget_before(self, stamp_ns: int) -> None:
        """Forget the states of stamps that have been smoothed."""
        self._noted = self._noted.since(stamp_ns)

    def report_smoothed(self, estimates: Estimates) -> Estimates:
        """Return the reported smoothed estimates, with their states.

        A target is reported if its track was confirmed at any time between the stamp and the last
        scan, and the report extends back to the scan in which the track began. Its state is the
        filter's at the stamp: tentative before the confirmation.
        """
        estimates = self._of_reported_classes(estimates)
        if not self.rule.labelled:
            return estimates
        track = estimates.track_id
        confirmed = self._records.label[self._records.state != TENTATIVE]
        noted = self._noted.labels_since(estimates.stamp_ns)
        kept = contains(confirmed, track) | contains(noted, track) | (track == 0)
        kept &= estimates.weight >= self.rule.delete[estimates.class_id]
        estimates = estimates.take(np.flatnonzero(kept))
        return replace(estimates, track_state=self._noted.states(estimates))

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the states in a snapshot."""
        to_snapshot(self._records, snapshot, "tracks")
        to_snapshot(self._noted.columns, snapshot, "noted")

    def from_snapshot(self, snapshot: Snapshot) -> None:
        """Restore the states from a snapshot.

        Raises
        ------
        ValueError
            If the tracker cannot have stored these values.
        """
        self._records = from_snapshot(ConfirmationRecords, snapshot, "tracks", {})
        self._noted = PastStates.of(from_snapshot(NotedStates, snapshot, "noted", {}))


def _odds(probability: FloatArray) -> FloatArray:
    """Return the odds of probabilities; finite for probabilities of 1 or more."""
    return probability / np.maximum(1.0 - probability, np.finfo(float).eps)


def _survival(estimates: Estimates, since_ns: IntArray, model: TrackerModel) -> FloatArray:
    """Return the probability that each target has survived since an earlier stamp, shape (T,)."""
    intervals = (estimates.stamp_ns - since_ns) * 1e-9 / model.modes.interval_s
    survival: FloatArray = model.modes.nominal_survival[estimates.class_id] ** intervals
    return survival


def _shortest_turn_s(model: TrackerModel) -> float:
    """Return the shortest turn of an antenna, seconds; 0 if none turns."""
    return min((r.rotation_s for r in model.radars if r.rotation_s), default=0.0)
