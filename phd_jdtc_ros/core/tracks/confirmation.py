"""Track confirmation and deletion: tentative, confirmed and coasting tracks.

A track is confirmed when its existence probability exceeds one threshold, and stays reported until
it falls below a lower one. A confirmed track that the last scan missed is coasting. The filter does
not report tentative tracks.

Outside all coverage nothing lowers a target's existence probability except the survival
probability. A track without coverage is no longer reported once its last detection is older than a
limit. The filter keeps it, so that it has the same number when it leaves a blind sector.

A track whose position is spread over many gates of the sensors is not reported either: a detection
among the many in its gates says little about it. Its next own detection makes it narrow again. A
scan after which a track is still spread over more than one gate has therefore not detected it, even
if it has made its existence more probable: several detections may be its own. It is coasting.

A target whose most probable class is at rest has a track like any other, but is not reported.

With clutter maps, a track that is probably stationary is not confirmed: the map will soon contain
it. Near fixed clutter, a track is taken as stationary until its velocity shows that it moves. Away
from it, a track is taken as moving until its velocity shows that it is stationary.

The thresholds come from `reporting_rule`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, contains, frozen
from ..bisection import count_below
from ..compilation import Bool1, Float1, Int1, compiled, inner
from ..models.tracker_model import TrackerModel
from ..sensors.of_gaussians.linearised import GATE_SIGMA
from ..sensors.view import View
from ..snapshot import (
    MAX_MASS,
    MAX_STAMP_NS,
    Snapshot,
    floats,
    from_snapshot,
    integers,
    to_snapshot,
)
from ..types import COASTING, CONFIRMED, TENTATIVE, Estimates, Scan
from .coverage import missed_and_spread, stationary_probability
from .past_states import NotedStates, PastStates
from .reporting_rule import MIN_EXISTENCE, ReportingRule

# Upper bound of counts and factors in a snapshot.
MAX_COUNT = 1e18


class ConfirmationRecords(NamedTuple):
    """Confirmation state of each live track, confirmed or not."""

    label: Annotated[IntArray, integers("T", 1, ascending=True)]  # Ascending, (T,)
    # Stamp of the last scan that swept the track, (T,).
    stamp_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    # Stamp of the track's last detection, (T,).
    detected_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    # Existence probability at `stamp_ns`, (T,).
    existence: Annotated[FloatArray, floats("T", 0.0, MAX_MASS)]
    # `TENTATIVE`, `CONFIRMED` or `COASTING`, (T,).
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]
    # Expected number of missed detections since confirmation, (T,).
    expected: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]
    # Actual number of missed detections since confirmation, (T,).
    missed: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]
    # Correction of the odds of existence for the misses since the last detection, (T,).
    factor: Annotated[FloatArray, floats("T", 0.0, MAX_COUNT)]

    @staticmethod
    def of_none() -> ConfirmationRecords:
        """Return a table without tracks."""
        none, nothing = np.zeros(0, dtype=np.int64), np.zeros(0)
        return frozen(
            ConfirmationRecords(none, none, none, nothing, none, nothing, nothing, nothing)
        )


# Intervals or revolutions without coverage after which a track is coasting.
PATIENCE = 1.5
EPSILON = float(np.finfo(float).eps)


class _Rule(NamedTuple):
    """The numbers of each class, (C,)."""

    survival: Float1  # Probability to survive a nominal interval
    confirm: Float1  # These are those of the `ReportingRule`
    delete: Float1
    hidden: Float1
    reported: Bool1
    record_weight: Float1


class _Estimated(NamedTuple):
    """The E estimates of a scan."""

    # The estimates by ascending label, first those without one, which have no record, (E,).
    rows: Int1
    track_id: Int1  # (E,)
    existence: Float1  # (E,)
    class_id: Int1  # (E,)
    miss_probability: Float1  # Probability that no radar of the scan detects each, (E,)
    stationary: Float1  # Probability that each is stationary, (E,)
    blurred: Bool1  # Whether each is spread too far to be reported, (E,)
    resolved: Bool1  # Whether each is spread over one gate at most, as if detected, (E,)


class _ScanEvidence(NamedTuple):
    """What a scan shows of a track."""

    covered: bool  # True if a detection was likely
    is_detected: bool
    is_missed: bool
    is_resolved: bool  # False if the track is spread over more than one gate
    since_ns: int  # Time since the last detection


class _Durations(NamedTuple):
    """Durations that confirmation depends on, nanoseconds."""

    interval: float  # Nominal interval of the survival probabilities
    same_revolution: float  # Scans less apart may belong to the same pass of the antenna
    patience: float  # See `PATIENCE`
    coasting: float  # See `ReportingRule.coasting_s`


@inner
def _odds(probability: float) -> float:
    """Return the odds of a probability; finite for probabilities of 1 or more."""
    return probability / max(1.0 - probability, EPSILON)


@inner
def _next_state(
    previous: int,
    look: _ScanEvidence,
    existence: tuple[float, float],
    class_id: int,
    stationary: float,
    rule: _Rule,
    durations: _Durations,
) -> int:
    """Return the state of a track; `existence` is its probability, corrected and as estimated."""
    corrected, estimated = existence
    is_stale, tentative = look.since_ns > durations.patience, previous == TENTATIVE
    delete = rule.delete[class_id]
    if tentative:
        reported = estimated > rule.confirm[class_id]
    else:
        least = rule.hidden[class_id] if is_stale and not look.covered else delete
        reported = corrected >= least and estimated >= min(MIN_EXISTENCE, delete)
    # Largest probability of being stationary, with clutter maps, with which a track is confirmed.
    # The probability is one half if nothing is known.
    max_stationary_to_confirm = 0.85
    # Largest probability of being stationary with which a confirmed track stays confirmed.
    max_stationary_confirmed = 0.9
    bound = max_stationary_to_confirm if tentative else max_stationary_confirmed
    recent = look.is_detected or look.covered or look.since_ns <= durations.coasting
    if not (reported and recent and stationary <= bound):
        return TENTATIVE
    still_coasts = not look.is_detected and previous == COASTING
    undetected = look.is_missed or is_stale or still_coasts or not look.is_resolved
    return COASTING if undetected else CONFIRMED


@inner
def _write_kept(
    before: ConfirmationRecords,
    record: int,
    unswept_ns: IntArray,
    swept: IntArray,
    found: int,
    after: ConfirmationRecords,
) -> int:
    """Write a record whose track no later scan has swept; return the number written so far."""
    label, stamp_ns = before.label[record] - 1, before.stamp_ns[record]
    place, target = count_below(unswept_ns, stamp_ns), count_below(swept, label)
    if (target < len(swept) and swept[target] == label) or (
        place == len(unswept_ns) or unswept_ns[place] != stamp_ns
    ):
        return found
    after.label[found], after.stamp_ns[found] = before.label[record], stamp_ns
    after.detected_ns[found], after.state[found] = before.detected_ns[record], before.state[record]
    after.existence[found] = before.existence[record]
    after.expected[found], after.missed[found] = before.expected[record], before.missed[record]
    after.factor[found] = before.factor[record]
    return found + 1


@compiled
def _next_records(
    stamp_ns: int,
    durations: _Durations,
    rule: _Rule,
    estimates: _Estimated,
    unswept_ns: Int1,
    swept: Int1,
    before: ConfirmationRecords,
) -> tuple[ConfirmationRecords, int, IntArray, BoolArray]:
    """Return the records after a scan and their number, and the state of each estimate.

    The last result is whether each is reported. `unswept_ns` and `swept` are those of
    `report_filtered`. The records `before` the scan remain if it has not swept their tracks.

    A detection raises the odds of existence. The odds of a track that is missed are corrected by
    its own record.
    """
    rows, track_id, estimated, class_of, miss_probability, stationary, blurred, resolved = estimates
    label = before.label
    record, found, most = 0, 0, len(label) + len(rows)
    after = ConfirmationRecords(
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most),
        np.empty(most, np.int64),
        np.empty(most),
        np.empty(most),
        np.empty(most),
    )
    states, is_reported = np.empty(len(rows), np.int64), np.empty(len(rows), np.bool_)
    for track in range(len(rows) + 1):
        row = rows[track] if track < len(rows) else -1
        while record < len(label) and (row < 0 or label[record] < track_id[row]):
            found = _write_kept(before, record, unswept_ns, swept, found, after)
            record += 1
        if row < 0:
            break
        class_id, weight = class_of[row], estimated[row]
        if track_id[row] == 0:
            states[row] = CONFIRMED if weight > rule.delete.min() else TENTATIVE
            is_reported[row] = states[row] != TENTATIVE and rule.reported[class_id]
            continue
        missing, odds = miss_probability[row], _odds(weight)
        has_record = record < len(label) and label[record] == track_id[row]
        covered = lower = is_missed = False
        previous_state, detected_ns = TENTATIVE, stamp_ns
        expected, missed, factor = 0.0, 0.0, 1.0
        if has_record:
            detected_ns, previous_state = before.detected_ns[record], before.state[record]
            expected, missed = before.expected[record], before.missed[record]
            # A target that a scan misses with a larger probability than this counts as not covered:
            # neither as missed nor as detected.
            max_miss_probability = 0.98
            factor, covered = before.factor[record], missing < max_miss_probability
            covered = covered and not blurred[row]
            intervals = (stamp_ns - before.stamp_ns[record]) / durations.interval
            survival = rule.survival[class_id] ** intervals
            lower = odds < _odds(before.existence[record] * survival)
            # A target at the edge of two slices is detected in one of them; the other is no miss.
            same_revolution = stamp_ns - detected_ns < durations.same_revolution
            is_missed = covered and lower and not same_revolution
        is_detected = not has_record or (covered and not lower and resolved[row])
        pseudo_count = rule.record_weight[class_id]
        if is_missed:
            factor *= (1.0 + missed / pseudo_count) / (1.0 + expected / pseudo_count)
        if is_detected or math.isinf(pseudo_count):
            factor = 1.0
        existence = weight
        if factor != 1.0:
            existence = odds * factor / (1.0 + odds * factor)
        if is_detected:
            detected_ns = stamp_ns
        since_ns = stamp_ns - detected_ns
        look = _ScanEvidence(covered, is_detected, is_missed, resolved[row], since_ns)
        believed, still = (existence, weight), stationary[row]
        state = _next_state(previous_state, look, believed, class_id, still, rule, durations)
        if blurred[row]:
            state = TENTATIVE
        if (is_missed or is_detected) and previous_state != TENTATIVE:
            expected += missing
            missed += is_missed
        states[row], is_reported[row] = state, state != TENTATIVE and rule.reported[class_id]
        after.label[found], after.stamp_ns[found] = track_id[row], stamp_ns
        after.detected_ns[found], after.state[found] = detected_ns, state
        after.existence[found], after.expected[found] = weight, expected
        after.missed[found], after.factor[found] = missed, factor
        found += 1
        record += has_record
    return after, found, states, is_reported


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
        # Labels of the last report's tracks that had no detection for `PATIENCE`, ascending.
        self.unseen: IntArray = self._records.label
        self._noted = PastStates()

    def report_filtered(
        self,
        estimates: Estimates,
        swept: IntArray,
        unswept_ns: Collection[int],
        scan: Scan,
        model: TrackerModel,
        views: Sequence[View],
    ) -> Estimates:
        """Return the reported estimates of a scan, with their states.

        The estimates are all with an existence probability above `ReportingRule.least`. `swept` are
        the labels of the targets that the scan swept, ascending, and `unswept_ns` the stamps of
        earlier scans with tracks that no later scan has swept. `views` has what is expected of each
        sensor of the model.
        """
        if not self.rule.labelled:
            return self._of_reported_classes(estimates)
        unswept_stamps = np.array(sorted(unswept_ns), dtype=np.int64)
        state, is_reported = self._continue(estimates, swept, unswept_stamps, scan, model, views)
        return estimates.changed(track_state=state).select(is_reported)

    def _of_reported_classes(self, estimates: Estimates) -> Estimates:
        return estimates.select(self.rule.reported[estimates.class_id])

    def _continue(
        self,
        estimates: Estimates,
        swept: IntArray,
        unswept_ns: IntArray,
        scan: Scan,
        model: TrackerModel,
        views: Sequence[View],
    ) -> tuple[IntArray, BoolArray]:
        """Continue the records; return the state of each estimate, and whether it is reported."""
        rule, modes = self.rule, model.modes
        revolutions_s = [radar.rotation_s for radar in model.radars if radar.rotation_s]
        # Scans less than this share of a revolution apart may belong to the same pass of the
        # antenna.
        same_revolution = 0.5
        durations = _Durations(
            interval=1e9 * modes.interval_s,
            same_revolution=1e9 * same_revolution * min(revolutions_s, default=0.0),
            patience=1e9 * PATIENCE * max([modes.interval_s, *revolutions_s]),
            coasting=1e9 * rule.coasting_s,
        )
        numbers = rule.confirm, rule.delete, rule.hidden, rule.reported, rule.record_weight
        missed, spread = missed_and_spread(estimates, scan, model, views)
        estimated = _Estimated(
            estimates.track_id.argsort(kind="stable"),
            estimates.track_id,
            estimates.weight,
            estimates.class_id,
            missed,
            stationary_probability(estimates, model, views),
            spread > GATE_SIGMA * rule.coasting_gates,
            ~(spread > GATE_SIGMA),
        )
        after, count, states, is_reported = _next_records(
            scan.stamp_ns,
            durations,
            frozen(_Rule(modes.nominal_survival, *numbers)),
            frozen(estimated),
            unswept_ns,
            swept,
            self._records,
        )
        kept = ConfirmationRecords(*(column[:count].copy() for column in after))
        self._records = frozen(kept)
        self.unseen = kept.label[kept.stamp_ns - kept.detected_ns > durations.patience]
        return states, is_reported

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
        is_reported = contains(confirmed, track) | contains(noted, track) | (track == 0)
        is_reported &= estimates.weight >= self.rule.delete[estimates.class_id]
        estimates = estimates.select(is_reported)
        return estimates.changed(track_state=self._noted.states(estimates))

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the states in a snapshot."""
        to_snapshot(self._records, snapshot, "tracks")
        to_snapshot(self._noted.columns, snapshot, "noted")

    def from_snapshot(self, snapshot: Snapshot) -> None:
        """Restore the states from a snapshot.

        Raise `ValueError` if the tracker cannot have stored these values.
        """
        self._records = frozen(from_snapshot(ConfirmationRecords, snapshot, "tracks", {}))
        self._noted = PastStates.of(from_snapshot(NotedStates, snapshot, "noted", {}))
