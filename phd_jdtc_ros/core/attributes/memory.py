"""Identity and height of each target, and their likelihood in data association."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, distinct_cells, sum_by
from ..sensors.report import Report
from ..snapshot import MOST_STAMP_NS, MOST_STATE, ROUNDING, covariances, floats, integers
from ..types import UNKNOWN, Attributes, Detections, Estimates
from . import height, identity, readings, uniqueness, updates
from .height import BoolArray, HeightModel, Heights
from .history import History
from .identity import ADDRESSES, CODES, Belief, IdentityModel
from .readings import Gate, Paired
from .uniqueness import Lost

# Smallest total association probability with which a target's beliefs are updated.
LEAST = 1e-12


@dataclass(frozen=True)
class AttributeModel:
    """Models of the identities and heights that detections report beside positions.

    Parameters
    ----------
    code, address : IdentityModel
    height : HeightModel
    clutter_reply : float
        Probability that a false detection has a reply.
    ages : bool
        Whether estimates have the time of the last detection by each sensor type.
    """

    code: IdentityModel
    address: IdentityModel
    height: HeightModel
    clutter_reply: float = 0.05
    ages: bool = False


class Records(NamedTuple):
    """Beliefs about T labels.

    Parameters
    ----------
    origin : int array of shape (T,)
        Labels, ascending.
    stamp_ns : int array of shape (T,)
        Time of the beliefs.
    code, code_weight : arrays of shape (T, K) and (T, K + 2)
        See `identity.Belief`.
    address, address_weight : arrays of shape (T, K) and (T, K + 2)
    height_known, height, height_covariance : arrays of shape (T,), (T, 2) and (T, 2, 2)
        See `height.Heights`.
    seen_ns : int array of shape (T, S)
        Time of the last detection by each sensor type; see `Attributes`.
    """

    origin: Annotated[IntArray, integers("T", 0, ascending=True)]
    stamp_ns: Annotated[IntArray, integers("T", 0, MOST_STAMP_NS)]
    code: Annotated[IntArray, integers("TK", UNKNOWN, CODES - 1)]
    code_weight: Annotated[FloatArray, floats("TW", 0.0, 1.0 + ROUNDING)]
    address: Annotated[IntArray, integers("TK", UNKNOWN, ADDRESSES - 1)]
    address_weight: Annotated[FloatArray, floats("TW", 0.0, 1.0 + ROUNDING)]
    height_known: Annotated[FloatArray, floats("T", 0.0, 1.0)]
    height: Annotated[FloatArray, floats("TA", -MOST_STATE, MOST_STATE)]
    height_covariance: Annotated[FloatArray, covariances("TAA", MOST_STATE)]
    seen_ns: Annotated[IntArray, integers("TS", UNKNOWN, MOST_STAMP_NS)]

    @staticmethod
    def of(
        origin: IntArray, stamp_ns: int, known: Known, seen_ns: IntArray | None = None
    ) -> Records:
        """Return records of beliefs; without `seen_ns` no sensor has detected the targets."""
        stamps = np.full(len(origin), stamp_ns, dtype=np.int64)
        seen_ns = updates.never(len(origin)) if seen_ns is None else seen_ns
        return Records(origin, stamps, *known.code, *known.address, *known.heights, seen_ns)

    @property
    def known(self) -> Known:
        """The beliefs without labels and stamps."""
        return Known(Belief(*self[2:4]), Belief(*self[4:6]), Heights(*self[6:9]))

    def take(self, rows: IntArray) -> Records:
        """Return the records of these rows."""
        columns: list[Any] = [column[rows] for column in self]
        return Records(*columns)

    def merge(self, other: Records) -> Records:
        """Return these records and others, which replace records of the same labels."""
        old = self.take(np.flatnonzero(~np.isin(self.origin, other.origin)))
        columns: list[Any] = [np.concatenate(pair) for pair in zip(old, other, strict=True)]
        return Records(*columns).take(np.argsort(columns[0], kind="stable"))


class Known(NamedTuple):
    """Beliefs about T targets."""

    code: Belief
    address: Belief
    heights: Heights

    @staticmethod
    def fresh(targets: int, model: AttributeModel) -> Known:
        """Return the prior beliefs about new targets."""
        return Known(
            Belief.fresh(targets, model.code),
            Belief.fresh(targets, model.address),
            Heights.fresh(targets),
        )

    def predict(self, dt: FloatArray, model: AttributeModel) -> Known:
        """Return the beliefs `dt` seconds later, (T,); identities are not predicted backwards."""
        return Known(
            self.code.predict(np.maximum(dt, 0.0), model.code),
            self.address.predict(np.maximum(dt, 0.0), model.address),
            self.heights.predict(dt, model.height),
        )


@dataclass(frozen=True)
class Evidence:
    """Likelihoods of identities and heights of one report's detections.

    Parameters
    ----------
    log_factor : array of shape (P,)
        Log factor of each pair's likelihood, which the engine computes from the state.
    log_clutter, log_unknown : arrays of shape (M,)
        Log factors of the intensities of clutter and of unknown targets at each detection.
    """

    log_factor: FloatArray
    log_clutter: FloatArray
    log_unknown: FloatArray
    _edge_of_pair: IntArray
    # Index in `_target` of each edge.
    _edge_target: IntArray
    # Engine's index and label of each target with a pair.
    _target: IntArray
    _origin: IntArray
    _compared: _Compared
    # Detection of each edge, and the targets' times of detection before this report.
    _edge_column: IntArray
    _detections: Detections
    _seen_ns: IntArray

    def take(self, pairs: IntArray) -> Evidence:
        """Return the evidence of these pairs alone."""
        return replace(
            self, log_factor=self.log_factor[pairs], _edge_of_pair=self._edge_of_pair[pairs]
        )


class _Compared(NamedTuple):
    """Likelihoods of the edges' detections; None for attributes that these do not report."""

    before: Known
    code: identity.ReplyLikelihood | None
    address: identity.ReplyLikelihood | None
    height: height.Measured | None

    def after(self, target: IntArray, own: FloatArray, none: FloatArray) -> tuple[Known, BoolArray]:
        """Return the beliefs after an association, and a mask of the heights that restart.

        See `identity.update` and `height.update`.
        """
        edges = target, own, none
        before = self.before
        heights, again = before.heights, np.zeros(len(none), dtype=np.bool_)
        if self.height is not None:
            heights, again = height.update(self.height, *edges)
        known = Known(
            before.code if self.code is None else identity.update(self.code, *edges),
            before.address if self.address is None else identity.update(self.address, *edges),
            heights,
        )
        return known, again


class AttributeMemory:
    """Keeps the beliefs about every label from scan to scan."""

    def __init__(self, model: AttributeModel) -> None:
        self.model = model
        self.records = Records.of(np.zeros(0, dtype=np.int64), 0, Known.fresh(0, model))
        self.history = History.empty()

    def evidence(
        self,
        origin: IntArray,
        target: IntArray,
        column: IntArray,
        detections: Detections,
        undetected: FloatArray,
        stamp_ns: int,
    ) -> Evidence | None:
        """Return the likelihoods of the identities and heights of one report.

        Parameters
        ----------
        origin : int array of shape (T,)
            Labels of the engine's targets.
        target, column : int arrays of shape (P,)
            The target and the detection of each pair.
        detections : Detections
        undetected : array of shape (T,)
            Existence probability of each target, given that it was not detected.
        stamp_ns : int
            Of the scan.

        Returns
        -------
        Evidence or None
            None if the radar reports neither identities, heights nor sensor types, and the model
            has no `ages`.
        """
        given = detections.code, detections.address, detections.height, detections.kind
        if all(part is None for part in given) and not self.model.ages:
            return None
        size = len(detections)
        edge, edge_of_pair = distinct_cells(target * size + column, len(origin) * size)
        edge_column = edge % max(size, 1)
        own, place = np.unique(edge // max(size, 1), return_inverse=True)
        place = place.ravel()
        records = self._at(origin[own], stamp_ns)
        address = _addresses(detections)
        taken = uniqueness.find_taken(
            *(records.known.address, place, edge_column),
            np.full(size, UNKNOWN) if address is None else address,
            *(undetected[own], self.model.address),
        )
        compared = self._compare(records.known, place, edge_column, detections, taken.by_another)
        log_factor = np.zeros(len(edge))
        for part in (compared.code, compared.address, compared.height):
            if part is not None:
                log_factor += part.log_factor
        return Evidence(
            log_factor[edge_of_pair],
            self._log_clutter(detections),
            taken.log_unknown,
            *(edge_of_pair, place, own, origin[own], compared),
            *(edge_column, detections, records.seen_ns),
        )

    def learn(
        self, evidence: Evidence, mass: FloatArray, existence: FloatArray, stamp_ns: int
    ) -> None:
        """Update the beliefs with the probabilities of an association.

        Parameters
        ----------
        evidence : Evidence
        mass : array of shape (P,)
            Joint probability that each pair's target exists, is represented by its row and is the
            source of its detection.
        existence : array of shape (T,)
            Existence probability of each target after the update.
        stamp_ns : int
            Of the scan.
        """
        edges, targets = len(evidence._edge_target), len(evidence._target)
        exists = np.maximum(existence[evidence._target], np.finfo(float).tiny)
        own = sum_by(evidence._edge_of_pair, mass, edges) / exists[evidence._edge_target]
        total = sum_by(evidence._edge_target, own, targets)
        own = own / np.maximum(total, 1.0)[evidence._edge_target]
        none = np.maximum(1.0 - total, 0.0)
        if not targets:
            return
        known, again = evidence._compared.after(evidence._edge_target, own, none)
        self.history = self.history.without(evidence._origin[again])
        updated = np.flatnonzero(total > LEAST)
        seen_ns = updates.update(
            *(evidence._seen_ns, evidence._edge_target, evidence._edge_column, own),
            *(evidence._detections, stamp_ns),
        )
        self._note(Records.of(evidence._origin, stamp_ns, known, seen_ns).take(updated), stamp_ns)

    def initiate(self, origin: int, detections: Detections, stamp_ns: int) -> None:
        """Initiate beliefs about targets born at detections, with ascending labels from `origin`.

        The identity and the height of a target are initiated by its detection.
        """
        count = len(detections)
        if not count:
            return
        place = np.arange(count)
        compared = self._compare(Known.fresh(count, self.model), place, place, detections)
        known, _ = compared.after(place, np.ones(count), np.zeros(count))
        seen_ns = updates.update(
            updates.never(count), place, place, np.ones(count), detections, stamp_ns
        )
        self._note(Records.of(origin + place, stamp_ns, known, seen_ns), stamp_ns)

    def describe(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return estimates with the heights and identities of their targets; tracks are labels.

        Parameters
        ----------
        estimates : Estimates
        smoothed : bool
            Whether heights are smoothed by later scans. Identities are always the latest.
        """
        origin = estimates.track_id - 1
        records = self._at(origin, estimates.stamp_ns)
        known = records.known
        heights = known.heights
        sure = heights.known > 0.5
        if smoothed:
            heights = self.history.smooth(origin, estimates.stamp_ns, self.model.height)
            sure &= heights.known > 0.5
        return replace(
            estimates,
            attributes=Attributes(
                height=np.where(sure[:, None], heights.mean, np.nan),
                height_covariance=np.where(sure[:, None, None], heights.covariance, np.nan),
                code=known.code.most_probable(),
                address=known.address.most_probable(),
                seen_ns=records.seen_ns if self.model.ages and not smoothed else None,
            ),
        )

    def addresses(self, origin: IntArray) -> tuple[IntArray, IntArray]:
        """Return the address of each label, or `UNKNOWN`, and the time of its last detection."""
        address, seen_ns = np.full((2, len(origin)), UNKNOWN)
        row, place = self._rows(origin)
        records = self.records
        address[row] = Belief(records.address[place], records.address_weight[place]).most_probable()
        seen_ns[row] = records.seen_ns[place].max(axis=1)
        return address, seen_ns

    def heights(self, origin: IntArray, stamp_ns: int) -> Heights:
        """Return the heights of labels, predicted to a stamp."""
        return self._at(origin, stamp_ns).known.heights

    def at(self, stamp_ns: int) -> AttributesAt:
        """Return the memory at a scan's stamp, for the engine's update."""
        return AttributesAt(self, stamp_ns)

    def forget_all_but(self, labels: Sequence[IntArray], stamp_ns: int) -> None:
        """Drop labels that are gone, and heights that no stamp from this one on needs."""
        alive = np.concatenate(labels)
        self.records = self.records.take(np.flatnonzero(np.isin(self.records.origin, alive)))
        self.history = self.history.since(stamp_ns, alive)

    def _at(self, origin: IntArray, stamp_ns: int) -> Records:
        """Return the records of labels, predicted to a stamp; priors for labels without one."""
        found = Records.of(origin, stamp_ns, Known.fresh(len(origin), self.model))
        row, place = self._rows(origin)
        kept = self.records.take(place)
        dt = (stamp_ns - kept.stamp_ns).astype(np.float64) * 1e-9
        predicted = Records.of(
            kept.origin, stamp_ns, kept.known.predict(dt, self.model), kept.seen_ns
        )
        for column, value in zip(found[2:], predicted[2:], strict=True):
            column[row] = value
        return found

    def _rows(self, origin: IntArray) -> tuple[IntArray, IntArray]:
        """Return the indices of labels with records, and the rows of those records."""
        place = np.searchsorted(self.records.origin, origin)
        inside = np.flatnonzero(place < len(self.records.origin))
        row = inside[self.records.origin[place[inside]] == origin[inside]]
        return row, place[row]

    def _compare(
        self,
        before: Known,
        target: IntArray,
        column: IntArray,
        detections: Detections,
        taken: FloatArray | float = 0.0,
    ) -> _Compared:
        """Return the likelihoods of the edges' detections; see `identity.compare`."""
        code, address, heights = detections.code, _addresses(detections), detections.height
        since = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
        model = self.model
        return _Compared(
            before,
            None
            if code is None
            else identity.compare(before.code, target, code[column], model.code),
            None
            if address is None
            else identity.compare(before.address, target, address[column], model.address, taken),
            None
            if heights is None
            else height.compare(
                before.heights, target, heights[column], since[column], model.height
            ),
        )

    def _log_clutter(self, detections: Detections) -> FloatArray:
        """Return the log factor of the clutter at each detection, (M,).

        Clutter with a reply shows identities as unknown targets do.
        """
        shown = [part for part in (detections.code, detections.address) if part is not None]
        if not shown:
            return np.zeros(len(detections))
        answered = np.stack([part != UNKNOWN for part in shown]).any(axis=0)
        false, true = self.model.clutter_reply, self.model.code.answered
        odds = np.array([(1.0 - false) / (1.0 - true), false / true])
        factor: FloatArray = np.log(odds)[answered.astype(np.int64)]
        return factor

    def _note(self, new: Records, stamp_ns: int) -> None:
        self.records = self.records.merge(new)
        tall = np.flatnonzero(new.height_known > 0.5)
        if len(tall):
            self.history = self.history.record(
                new.origin[tall], stamp_ns, new.known.heights.take(tall)
            )


class AttributesAt(NamedTuple):
    """The attribute memory at the stamp of a scan, as an engine's update uses it."""

    memory: AttributeMemory
    stamp_ns: int

    def evidence(
        self,
        origin: IntArray,
        target: IntArray,
        column: IntArray,
        detections: Detections,
        undetected: FloatArray,
    ) -> Evidence | None:
        """Return the likelihoods of a report; see `AttributeMemory.evidence`."""
        return self.memory.evidence(origin, target, column, detections, undetected, self.stamp_ns)

    def pair(
        self,
        gate: Gate,
        origin: IntArray,
        target: IntArray,
        report: Report,
    ) -> Paired:
        """Return the pairs in gates, with false heights replaced by those of the targets.

        Parameters
        ----------
        gate : Gate
        origin : int array of shape (T,)
            Labels of the engine's targets.
        target : int array of shape (N,)
            Target of each of the engine's rows.
        report : Report
        """
        reading, detections = report.sensor.height_reading, report.detections
        if reading is None or detections.height is None:
            return readings.plain(gate, detections)
        heights = self.memory.heights(origin, self.stamp_ns)
        model = self.memory.model.height
        std = report.noise_std
        return readings.pair(gate, target, heights, detections, std, reading, model)

    def lost(
        self, origin: IntArray, target: IntArray, column: IntArray, detections: Detections
    ) -> Lost | None:
        """Return the targets whose identities detections show outside their gates.

        Parameters
        ----------
        origin : int array of shape (T,)
            Labels of the engine's targets.
        target, column : int arrays of shape (P,)
            The target and the detection of each pair in a gate.
        detections : Detections
        """
        memory, shown = self.memory, _addresses(detections)
        if shown is None or not memory.model.address.unique:
            return None
        has, seen_ns = memory.addresses(origin)
        shown_ns = updates.times_of(detections, self.stamp_ns)
        return uniqueness.lost(has, seen_ns, shown, shown_ns, (target, column))

    def learn(self, evidence: Evidence, mass: FloatArray, existence: FloatArray) -> None:
        """Update the beliefs after an association; see `AttributeMemory.learn`."""
        self.memory.learn(evidence, mass, existence, self.stamp_ns)

    def initiate(self, origin: int, detections: Detections) -> None:
        """Initiate beliefs about targets born at detections; see `AttributeMemory.initiate`."""
        self.memory.initiate(origin, detections, self.stamp_ns)


def _addresses(detections: Detections) -> IntArray | None:
    """Return the addresses; a missing one is no evidence if the code shows that no reply came."""
    if detections.address is None or detections.code is None:
        return detections.address
    silent = (detections.code == UNKNOWN) & (detections.address == UNKNOWN)
    return np.where(silent, identity.NOTHING, detections.address)
