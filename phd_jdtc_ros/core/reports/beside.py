"""The layer of self-reports as one value, from scan to scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import UNKNOWN, BoolArray, FloatArray, IntArray, frozen, matches
from ..snapshot import Snapshot, from_snapshot, to_snapshot
from ..types import Estimates
from ..types.reports import NAME_SIZE, SelfReports, is_of
from . import bias, judgement, silence
from .batches import Tables, batch_of, chains_of, describe_sources, keys_of, selected
from .looks import moments, take_look
from .model import MOST_PAIRS, MOST_SOURCES, RELIABILITY, Receiver, Reliability
from .owners import NUMBERED, OWN_LABELS, owner_probabilities, with_public
from .pairs import Assumed, Used, adopted, take_reports
from .smoothing import MAX_LINKS, links_of, mixture
from .tables import (
    Biases,
    LayerState,
    Learned,
    Links,
    Look,
    Pairs,
    Rows,
    Sources,
    Tracks,
    concatenate,
    extended,
    take,
)

# Name of the arrays in a snapshot, and their sizes.
NAME = "reports"
SIZES = {"G": 4, "H": 6, "A": 2, "B": 2, "F": 5}
# Sources are kept for this time after their last report, seconds.
KEPT_S = 600.0
# A source that is silent for longer was not where a radar looks now, seconds.
ACTIVE_S = 60.0
# Existence probability from which a track is known.
KNOWN = 0.99
# Owner probability from which a source owns a track, and from which it certainly does.
OWNED, CERTAIN = 0.5, 0.99
# Weight of a configured probability against the learned one, as a number of targets.
PRIOR_TARGETS = 10.0


@dataclass(frozen=True, eq=False)
class SelfReporting(LayerState):
    """The layer after some scan; its methods return the layer after what they are named for."""

    @staticmethod
    def of(
        receivers: tuple[Receiver, ...],
        noise_density: float,
        look_s: float,
        classes: int,
        radars: int,
    ) -> SelfReporting:
        """Return the layer before any report."""
        count, none = len(receivers), np.zeros(0, dtype=np.int64)
        return SelfReporting(
            receivers,
            noise_density,
            classes,
            look_s,
            Sources.none(),
            Pairs.none(),
            Tracks.none(classes),
            (),
            Learned(
                np.zeros(count, dtype=np.int64),
                np.zeros((count, 5)),
                np.zeros((count, 2)),
                np.array([each.off_prior for each in receivers]),
                np.zeros(2, dtype=np.int64),
                none,
            ),
            Biases(np.zeros((radars, 2, 2)), np.zeros((radars, 2)), np.zeros(radars, np.int64)),
        )

    # Reports

    def with_reports(self, reports: SelfReports, stamp_ns: int) -> SelfReporting:
        """Return the layer after what receivers heard up to a stamp, in any order.

        Reports that are older than their receiver allows, or of a later time, say only that their
        transmitters are on: a clock that stands still makes no ship dark.
        """
        age_s = (stamp_ns - reports.time_ns) * 1e-9
        oldest_s = np.array([each.max_age_s for each in self.receivers])[reports.receiver]
        timely = (age_s >= 0.0) & (age_s <= oldest_s)
        layer = self._with_signs_of(reports.take(np.flatnonzero(~timely)), stamp_ns)
        layer = layer._without_silent(stamp_ns)
        reports = selected(reports.take(np.flatnonzero(timely)))
        if not len(reports):
            return layer
        batch = batch_of(reports, layer.receivers)
        known, pairs = layer.sources, layer.pairs
        most = min(len(reports), MOST_SOURCES - len(known.number))
        tables = Tables(
            extended(known, max(most, 0)),
            extended(pairs, MOST_PAIRS * len(reports)),
            chains_of(reports, known, pairs, max(most, 0)),
        )
        used, source_of = take_reports(
            batch,
            layer._assumed,
            layer._rules,
            layer.tracks,
            Used(len(known.number), len(pairs.number), *layer.learned.next.tolist()),
            tables,
        )
        row = source_of[source_of >= 0]
        kept = reports.take(np.flatnonzero(source_of >= 0))
        if not len(kept):
            return layer
        sources = tables.sources
        describe_sources(sources, kept, row)
        sources = take(sources, slice(0, used.sources))
        # A row whose path was given up has a later number than its neighbours.
        sources = take(sources, np.argsort(sources.number, kind="stable"))
        alive = layer.learned.alive_ns.copy()
        np.maximum.at(alive, kept.receiver, np.minimum(kept.time_ns, stamp_ns))
        layer = layer.changed(
            sources=sources,
            pairs=take(tables.pairs, slice(0, used.pairs)),
            learned=layer.learned._replace(
                next=np.array([used.source_number, used.pair_number]),
                alive_ns=alive,
                received=layer._received_with(known, sources),
            ),
        )
        return layer._kept()._with_owners(stamp_ns)._heard_at(kept)

    def _with_signs_of(self, reports: SelfReports, stamp_ns: int) -> SelfReporting:
        """Return the layer with the sources that are on, of reports with wrong times."""
        sources = self.sources
        on = np.isin(
            keys_of(sources.address, sources.space), keys_of(reports.address, reports.space)
        )
        on &= sources.address != UNKNOWN
        if not on.any():
            return self
        return self.changed(
            sources=frozen(sources._replace(on_ns=np.where(on, stamp_ns, sources.on_ns)))
        )

    @property
    def _rules(self) -> Reliability:
        return RELIABILITY._replace(noise_density=self.noise_density)

    @property
    def _assumed(self) -> Assumed:
        habits = [each.habits for each in self.receivers]
        return frozen(
            Assumed(
                np.array([each.offset_std for each in self.receivers]),
                np.log([each.area for each in habits]),
                2.0 * np.log([2.0 * each.fastest for each in habits]),
            )
        )

    def _received_with(self, before: Sources, after: Sources) -> FloatArray:
        """Return the counts of received and lost reports with those of certain sources."""
        row, earlier = matches(before.number, after.number)
        certain = (after.owner[row] >= 0) & (after.left_ns[row] == 0)
        row, earlier = row[certain], earlier[certain]
        got = (after.reports[row] - before.reports[earlier]).astype(np.float64)
        row, earlier, got = row[got > 0.0], earlier[got > 0.0], got[got > 0.0]
        span_s = (after.last_ns[row] - before.last_ns[earlier]) * 1e-9
        interval_s, receiver = self.intervals(take(after, row)), after.receiver[row]
        lost = np.maximum(np.rint(span_s / interval_s) - got, 0.0)
        hidden = np.zeros(len(row))
        for index, losses in enumerate(self.losses):
            mine = receiver == index
            hidden[mine] = losses.hiding(lost[mine], interval_s[mine])
        counts = got, got + (1.0 - hidden) * lost, span_s, hidden * lost * interval_s, hidden
        total: FloatArray = self.learned.received.copy()
        np.add.at(total, receiver, np.stack(counts, axis=1))
        return total

    def _heard_at(self, kept: SelfReports) -> SelfReporting:
        """Return the layer with the cells in which trusted sources were heard."""
        owned = self.owned
        trusted = (owned > OWNED) | (self.sources.looks < judgement.LOOKS)
        cells = self.learned.cells
        for index, receiver in enumerate(self.receivers):
            mine = trusted & (self.sources.receiver == index)
            recent = mine & (self.sources.last_ns >= kept.time_ns.min())
            place = self.sources.mean[recent, :2]
            cells = silence.with_cells(cells, place, index, receiver)
        return self.changed(learned=self.learned._replace(cells=cells))

    # Looks of radars

    def after(self, rows: Rows, look: Look, seen: BoolArray) -> SelfReporting:
        """Return the layer after a radar's look.

        Parameters
        ----------
        rows : Rows
            The hypotheses before the look.
        look : Look
        seen : bool array of shape (S,)
            Whether the radar should have seen a target at the place of each source.
        """
        sources, stamp_ns = self.sources, look.stamp_ns
        seen = seen & ((stamp_ns - sources.last_ns) * 1e-9 < ACTIVE_S)
        # A person in the water is not false because no radar sees one.
        seen &= ~is_of("small_radio", sources.address, sources.space)
        before = np.where((stamp_ns - sources.looked_ns) * 1e-9 < ACTIVE_S, sources.looks, 0)
        sources = frozen(
            sources._replace(
                looks=np.where(seen, before + 1, sources.looks),
                looked_ns=np.where(seen, stamp_ns, sources.looked_ns),
            )
        )
        pairs = extended(self.pairs, 0)
        take_look(rows, look, bias.corrected(self.biases, look), self.noise_density, pairs)
        offset_std = self._assumed.offset_std[sources.receiver]
        biases = bias.learned(
            self.biases,
            look,
            rows.label,
            sources,
            self.pairs,
            RELIABILITY.unsteady * self.noise_density,
            offset_std**2 * bias.MEMORY_S / self.look_s,
        )
        return self.changed(sources=sources, pairs=frozen(pairs), biases=biases)

    def places(self, stamp_ns: int) -> FloatArray:
        """Return where the reports of each source expect it at a stamp, metres, (S, 2)."""
        sources = self.sources
        dt = (stamp_ns - sources.last_ns)[:, None] * 1e-9
        place: FloatArray = sources.mean[:, :2] + dt * sources.mean[:, 2:4]
        return place

    # The end of a scan

    def noted(self, rows: Rows, living: IntArray, stamp_ns: int) -> SelfReporting:
        """Return the layer after a scan.

        Parameters
        ----------
        rows : Rows
            The hypotheses after the scan, of the targets that it swept.
        living : int array
            The labels of all targets, ascending.
        """
        layer, new = self._with_tracks(rows, living, stamp_ns)
        layer = layer._adopted(new, stamp_ns)._without_superseded(stamp_ns)._kept()
        layer = layer._with_owners(stamp_ns)
        layer = layer._with_off(stamp_ns)
        sources, tracks = with_public(layer.sources, layer.tracks, layer.pairs)
        pairs, links = links_of(layer.pairs)
        kept = (*layer.links, links) if len(links.number) else layer.links
        return layer.changed(sources=sources, tracks=tracks, pairs=pairs, links=kept[-MAX_LINKS:])

    def _with_tracks(
        self, rows: Rows, living: IntArray, stamp_ns: int
    ) -> tuple[SelfReporting, IntArray]:
        """Return the layer with the tracks after a scan, and the rows of those now known."""
        old, count = self.tracks, len(rows.label)
        row, before = matches(old.label, rows.label)
        stamp, none, unheard = (np.full(count, each) for each in (stamp_ns, 0, -1))
        own = stamp.copy(), none, none.copy(), unheard, rows.label.copy()
        swept = Tracks(rows.label, stamp, *moments(rows), *own)
        for name in ("born_ns", "known_ns", "heard_ns", "heard", "public"):
            getattr(swept, name)[row] = getattr(old, name)[before]
        is_new = (swept.known_ns == 0) & (swept.existence > KNOWN)
        swept.known_ns[is_new] = stamp_ns
        others = np.isin(old.label, rows.label, invert=True)
        joined = concatenate([take(old, np.flatnonzero(others)), frozen(swept)])
        joined = take(joined, np.argsort(joined.label, kind="stable"))
        lives = np.isin(joined.label, living)
        ended = take(joined, np.flatnonzero(~lives & (joined.known_ns > 0)))
        tracks = take(joined, np.flatnonzero(lives))
        layer = self.changed(tracks=tracks)
        if len(ended.label):
            pairs = take(self.pairs, np.isin(self.pairs.label, ended.label))
            off = layer.changed(tracks=ended, pairs=pairs)._off_of(stamp_ns)
            learned = layer.learned._replace(ended=layer.learned.ended + off)
            layer = layer.changed(learned=learned)
        new = np.flatnonzero(np.isin(tracks.label, rows.label[is_new]))
        return layer, new

    def _adopted(self, new: IntArray, stamp_ns: int) -> SelfReporting:
        """Return the layer with pairs of new tracks and the sources that were heard before.

        Their last reports may be those of the tracks, before they were known.
        """
        if not (len(new) and len(self.sources.number)):
            return self
        pairs, tracks, next_pair = adopted(
            (self.sources, self.pairs, self.tracks),
            new,
            stamp_ns,
            self._assumed,
            self._rules,
            int(self.learned.next[1]),
        )
        numbers = np.array([self.learned.next[0], next_pair])
        learned = self.learned._replace(next=numbers)
        return self.changed(pairs=pairs, tracks=tracks, learned=learned)

    def _kept(self) -> SelfReporting:
        """Return the layer without improbable pairs, and without those of ended tracks."""
        pairs = self.pairs
        keep = (pairs.log_weight >= RELIABILITY.floor) & np.isin(pairs.source, self.sources.number)
        keep &= np.isin(pairs.label, self.tracks.label)
        order = np.lexsort((-pairs.log_weight, pairs.source))
        rank = np.arange(len(order)) - pairs.source[order].searchsorted(pairs.source[order])
        keep[order[rank >= MOST_PAIRS]] = False
        return self if keep.all() else self.changed(pairs=take(pairs, np.flatnonzero(keep)))

    def _without_silent(self, stamp_ns: int) -> SelfReporting:
        """Return the layer without sources that are silent for long, and within their bound."""
        sources = self.sources
        keep = stamp_ns - np.maximum(sources.last_ns, sources.on_ns) <= KEPT_S * 1e9
        most = MOST_SOURCES - MOST_SOURCES // 10
        if np.count_nonzero(keep) > most:
            owned = self.owned > OWNED
            order = np.lexsort((sources.last_ns, owned, keep))
            keep = np.zeros(len(keep), dtype=np.bool_)
            keep[order[-most:]] = True
        if keep.all():
            return self
        return self.changed(sources=take(sources, np.flatnonzero(keep)))._kept()

    def _without_superseded(self, stamp_ns: int) -> SelfReporting:
        """Return the layer without sources whose transmitters go on elsewhere.

        A path of the same address that began after a source's last report is that of the same
        transmitter, once two reports of the source are missing: it has left the source's track.
        Of clones both are heard, and none is left.
        """
        sources = self.sources
        newest = judgement.newest_of_address(sources)
        silent_s = (self.learned.alive_ns[sources.receiver] - sources.last_ns) * 1e-9
        ended = judgement.goes_on_elsewhere(sources)
        ended &= silent_s > 2.0 * self.intervals(sources)
        if not ended.any():
            return self
        owner, left_ns = sources.owner.copy(), sources.left_ns.copy()
        looks, reports = sources.looks.copy(), sources.reports.copy()
        for row in np.flatnonzero(ended).tolist():
            after = newest[row]
            # Radars have looked for this transmitter, wherever it said that it was.
            looks[after], reports[after] = looks[after] + looks[row], reports[after] + reports[row]
            if owner[row] >= 0 > owner[after]:
                owner[after], left_ns[after] = owner[row], left_ns[row] or stamp_ns
        kept = sources._replace(owner=owner, left_ns=left_ns, looks=looks, reports=reports)
        return self.changed(sources=take(kept, np.flatnonzero(~ended)))

    def _with_owners(self, stamp_ns: int) -> SelfReporting:
        """Return the layer with the present probabilities of owners, and what follows from them."""
        pairs, sources, tracks = self.pairs, self.sources, self.tracks
        row = sources.number.searchsorted(pairs.source)
        owned = owner_probabilities(pairs.source, pairs.label, sources.space[row], pairs.log_weight)
        # Reports count once: those since the pair was last judged.
        track = tracks.label.searchsorted(pairs.label)
        fresh = pairs.heard_ns > np.where(
            tracks.heard[track] == pairs.source, tracks.heard_ns[track], 0
        )
        certain = np.where(owned > CERTAIN, pairs.certain + fresh, 0)
        heard_ns, heard = tracks.heard_ns.copy(), tracks.heard.copy()
        (own,) = ((owned > OWNED) & (pairs.heard_ns > 0)).nonzero()
        heard_ns[track[own]] = pairs.heard_ns[own]
        heard[track[own]] = pairs.source[own]
        owner, left_ns = sources.owner.copy(), sources.left_ns.copy()
        (sure,) = (certain >= NUMBERED).nonzero()
        owner[row[sure]], left_ns[row[sure]] = pairs.label[sure], 0
        still = np.zeros(len(owner))
        of_owner = pairs.label == owner[row]
        still[row[of_owner]] = owned[of_owner]
        has_left = np.isin(owner, tracks.label) & (still < OWNED) & (left_ns == 0)
        left_ns[has_left] = stamp_ns
        return self.changed(
            pairs=frozen(pairs._replace(owned=owned, certain=certain.astype(np.int64))),
            sources=frozen(sources._replace(owner=owner, left_ns=left_ns)),
            tracks=frozen(tracks._replace(heard_ns=heard_ns, heard=heard)),
        )

    def _off_of(self, stamp_ns: int) -> FloatArray:
        """Return the probable numbers of dark and of obliged tracks by receiver, (K, 2)."""
        found = np.zeros_like(self.learned.ended)
        for index in range(len(self.receivers)):
            own = judgement.of_receiver(self, index, stamp_ns)
            known = (self.tracks.known_ns > 0) & own.covered
            found[index] = own.dark[known].sum(), own.obliged[known].sum()
        return found

    def _with_off(self, stamp_ns: int) -> SelfReporting:
        """Return the layer with the learned probability that an obliged target is off."""
        prior = np.array([each.off_prior for each in self.receivers])
        count = self.learned.ended + self._off_of(stamp_ns)
        off = (PRIOR_TARGETS * prior + count[:, 0]) / (PRIOR_TARGETS + count[:, 1])
        return self.changed(learned=self.learned._replace(off=off))

    # Estimates

    def describe(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return estimates, whose `track_id` is still label + 1, with what reports say of them.

        Those of tracks with sources are mixtures of the radar's track and of its pairs, and sources
        without a track are further estimates.
        """
        said = judgement.of_estimates(self, estimates.track_id - 1, estimates.stamp_ns)
        fused = mixture(self, estimates, smoothed)
        return judgement.joined(self, fused, said)

    def of_labels(self, oldest_ns: int) -> SelfReporting:
        """Return the layer without links that no pair needs to get back to a stamp."""
        waiting = self.pairs.number[self.pairs.since_ns > oldest_ns]
        kept: list[Links] = []
        for each in reversed(self.links):
            if np.isin(each.number, waiting).any():
                kept.insert(0, each)
            waiting = np.setdiff1d(waiting, each.number[each.time_ns <= oldest_ns])
        return self if len(kept) == len(self.links) else self.changed(links=tuple(kept))

    @property
    def labels(self) -> IntArray:
        """The labels whose numbers are in use beside those of the engine's targets."""
        sources = self.sources
        own = OWN_LABELS + sources.number
        return np.concatenate([own, sources.public[sources.public >= 0], self.tracks.public])

    def figures(self) -> dict[str, float]:
        """Return what was learned of the receivers, by dotted name."""
        lost = [each.lost for each in self.losses]
        return {
            f"{receiver.name}.{name}": float(value[index])
            for index, receiver in enumerate(self.receivers)
            for name, value in (("lost", lost), ("off", self.learned.off))
        }

    # Snapshots

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the layer."""
        for name in ("learned", "biases", "sources", "pairs", "tracks"):
            to_snapshot(getattr(self, name), snapshot, f"{NAME}.{name}")
        for index, links in enumerate(self.links):
            to_snapshot(links, snapshot, f"{NAME}.links.{index}")

    def restored(self, snapshot: Snapshot) -> SelfReporting:
        """Return the stored layer; this one if the snapshot has none.

        Raise `ValueError` if the tracker cannot have stored these values.
        """
        if not snapshot.names_below(NAME):
            return self
        sizes = {**SIZES, "N": NAME_SIZE, "C": self.classes, "K": len(self.receivers)}
        sizes["R"] = len(self.biases.total)
        biases = frozen(from_snapshot(Biases, snapshot, f"{NAME}.biases", sizes))
        learned = from_snapshot(Learned, snapshot, f"{NAME}.learned", sizes)
        sources = frozen(from_snapshot(Sources, snapshot, f"{NAME}.sources", sizes))
        pairs = frozen(from_snapshot(Pairs, snapshot, f"{NAME}.pairs", sizes))
        tracks = frozen(from_snapshot(Tracks, snapshot, f"{NAME}.tracks", sizes))
        known = np.isin(pairs.source, sources.number) & np.isin(pairs.label, tracks.label)
        if not known.all():
            raise ValueError(f"{NAME}.pairs: a source or a track is missing")
        if len(sources.receiver) and sources.receiver.max() >= len(self.receivers):
            raise ValueError(f"{NAME}.sources.receiver: must be below {len(self.receivers)}")
        links = tuple(
            frozen(from_snapshot(Links, snapshot, f"{NAME}.links.{index}", sizes))
            for index in range(len(snapshot.names_below(f"{NAME}.links")))
        )
        return self.changed(
            sources=sources,
            pairs=pairs,
            tracks=tracks,
            links=links,
            learned=learned,
            biases=biases,
        )
