"""What the layer knows: columns as compiled functions and snapshots have them, and all as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol, TypeVar, get_type_hints

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly, frozen
from ..compilation import Float1, Float2, Float3, Float4, Int1
from ..snapshot import MAX_INDEX, MAX_STAMP_NS, MAX_STATE, Snapshot, covariances, floats, integers
from ..types import Estimates, SelfReports
from ..types.reports import NAME_SIZE
from .model import Receiver
from .silence import Losses

TableT = TypeVar("TableT", bound=tuple[Any, ...])
# Largest bound of log likelihood ratios in snapshots.
MOST_LOG = 1e6
# Weight of a configured probability against the learned one, as a number of reports.
PRIOR_REPORTS = 50.0
# The same for the usual share of hidden transmitters, seconds, and for how long they are hidden.
PRIOR_S, PRIOR_STRETCHES = 5000.0, 2.0


class Sources(NamedTuple):
    """Sources: transmitters of one address whose reports follow one path, by ascending number."""

    number: Annotated[IntArray, integers("S", 0, ascending=True)]
    address: Annotated[IntArray, integers("S", -1, 1 << 32)]
    space: Annotated[IntArray, integers("S", 0, 4)]
    receiver: Annotated[IntArray, integers("S", 0, 1 << 16)]  # That heard it last
    first_ns: Annotated[IntArray, integers("S", 0, MAX_STAMP_NS)]  # Time of its first report
    last_ns: Annotated[IntArray, integers("S", 0, MAX_STAMP_NS)]  # And of its last one
    # When it last sent a report of a wrong time, which shows no more than that it is on.
    on_ns: Annotated[IntArray, integers("S", 0, MAX_STAMP_NS)]
    # The ghost: position and velocity as its reports alone show them, at `last_ns`, and the error
    # of the velocities that they say.
    mean: Annotated[FloatArray, floats("SH", -MAX_STATE, MAX_STATE)]
    covariance: Annotated[FloatArray, covariances("SHH", MAX_STATE)]
    ahead: Annotated[FloatArray, floats("SA", -1.0, 1.0)]  # Direction of the bow; 0, 0 if unknown
    # Shortest time between reports, at first of its kind of transmitters; 0: unknown.
    gap_s: Annotated[FloatArray, floats("S", 0.0, 1e9)]
    reports: Annotated[IntArray, integers("S", 0)]
    # Looks of radars that should have seen a target at its place, and the time of the last one.
    looks: Annotated[IntArray, integers("S", 0)]
    looked_ns: Annotated[IntArray, integers("S", 0, MAX_STAMP_NS)]
    # Label of the last certain owner, and since when it owns it no more, -1 and 0 without.
    owner: Annotated[IntArray, integers("S", -1)]
    left_ns: Annotated[IntArray, integers("S", 0, MAX_STAMP_NS)]
    # Label whose track number goes along with the source; -1 before it was certain.
    public: Annotated[IntArray, integers("S", -1)]
    type: Annotated[IntArray, integers("S", -1, 1 << 16)]
    height: Annotated[FloatArray, floats("S", -MAX_STATE, MAX_STATE)]  # `MAX_STATE` if unknown
    name: Annotated[IntArray, integers("SN", 0, 255)]

    @staticmethod
    def none() -> Sources:
        """Return no sources."""
        return frozen(_empty(Sources, {"H": 6, "A": 2, "N": NAME_SIZE}))


class Pairs(NamedTuple):
    """Pairs of a source and a track that may be its own, each with a filter of both."""

    number: Annotated[IntArray, integers("P", 0)]
    source: Annotated[IntArray, integers("P", 0)]  # Number of the source
    label: Annotated[IntArray, integers("P", 0)]  # Of the track
    time_ns: Annotated[IntArray, integers("P", 0, MAX_STAMP_NS)]
    mean: Annotated[FloatArray, floats("PH", -MAX_STATE, MAX_STATE)]
    covariance: Annotated[FloatArray, covariances("PHH", MAX_STATE)]
    # Log of "the source reports this track, and rightly" against "it does not".
    log_weight: Annotated[FloatArray, floats("P", -MOST_LOG, MOST_LOG)]
    owned: Annotated[FloatArray, floats("P", 0.0, 1.0)]  # Probability that the source owns it
    certain: Annotated[IntArray, integers("P", 0)]  # Reports in a row with a certain owner
    heard_ns: Annotated[IntArray, integers("P", 0, MAX_STAMP_NS)]  # Time of its last report
    # The link back to the state at `since_ns`; see `filters.link_back`.
    since_ns: Annotated[IntArray, integers("P", 0, MAX_STAMP_NS)]
    shift: Annotated[FloatArray, floats("PH", -1e12, 1e12)]
    gain: Annotated[FloatArray, floats("PHH", -1e12, 1e12)]
    rest: Annotated[FloatArray, floats("PHH", -1e18, 1e18)]

    @staticmethod
    def none() -> Pairs:
        """Return no pairs."""
        return frozen(_empty(Pairs, {"H": 6}))


class Tracks(NamedTuple):
    """The radar tracks as they were after their last looks, by ascending label."""

    label: Annotated[IntArray, integers("T", 0, ascending=True)]
    time_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    mean: Annotated[FloatArray, floats("TG", -MAX_STATE, MAX_STATE)]  # Position and velocity
    covariance: Annotated[FloatArray, covariances("TGG", MAX_STATE)]
    existence: Annotated[FloatArray, floats("T", 0.0, 100.0)]
    class_probability: Annotated[FloatArray, floats("TC", 0.0, 100.0)]
    born_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    known_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]  # Certain since; 0 if not yet
    # Time of the last report of its own, and its source; 0 and -1 without one.
    heard_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    heard: Annotated[IntArray, integers("T", -1)]
    # Label under whose number the track is published; its own, unless a source took another along.
    public: Annotated[IntArray, integers("T", 0)]

    @staticmethod
    def none(classes: int) -> Tracks:
        """Return no tracks."""
        return frozen(_empty(Tracks, {"G": 4, "C": classes}))


class Rows(NamedTuple):
    """The hypotheses of T targets, by label; the axes are those of `state_space.SPATIAL`."""

    label: Int1  # The distinct labels, ascending, (T,)
    target: Int1  # Index of each hypothesis's target, (H,)
    weight: Float3  # (H, R, C)
    mean: Float3  # (H, R, D)
    covariance: Float4  # (H, R, D, D)


class Look(NamedTuple):
    """What the update with a report says of its plots."""

    stamp_ns: int
    radar: int  # Index of the radar
    position: Float2  # Of the plots in the world, at their own times, metres, (M, 2)
    noise: Float3  # Their covariances, (M, 2, 2)
    # Errors in the plane of one standard deviation of each component, 0 if unknown, (M, 2, 2)
    root: Float3
    time_s: Float1  # Their times relative to the stamp, (M,)
    target: Int1  # Index of each pair's target in `Rows.label`, (E,)
    column: Int1  # Its plot, (E,)
    probability: Float1  # That the plot is the target's, if it exists, (E,)
    missed: Float1  # That the target has none of them, (T,)


class Learned(NamedTuple):
    """What was learned of K receivers."""

    # Time of the last report that each got: it is silent itself since then.
    alive_ns: Annotated[IntArray, integers("K", 0, MAX_STAMP_NS)]
    # Of sources with owners: numbers of received reports, and of those that were sent while they
    # were in sight; how long they were observed and hidden, seconds, and how often hidden, (K, 5).
    received: Annotated[FloatArray, floats("KF", 0.0, 1e15)]
    # Probable numbers of ended targets that did not transmit and of those that are obliged, (K, 2).
    ended: Annotated[FloatArray, floats("KB", 0.0, 1e15)]
    # Probability that an obliged target does not transmit.
    off: Annotated[FloatArray, floats("K", 0.0, 1.0)]
    # The next number of a source and of a pair.
    next: Annotated[IntArray, integers("B", 0)]
    # Cells in which each receiver heard sources, see `silence`.
    cells: Annotated[IntArray, integers("E", 0, ascending=True)]


class Biases(NamedTuple):
    """What is known of the biases of R radars, in their standard deviations; see `bias`."""

    information: Annotated[FloatArray, floats("RBB", -1e15, 1e15)]
    total: Annotated[FloatArray, floats("RB", -1e15, 1e15)]  # Information times bias
    time_ns: Annotated[IntArray, integers("R", 0, MAX_STAMP_NS)]  # Of the last look


class Links(NamedTuple):
    """Links of pairs back to their states at earlier scans, of one scan."""

    number: Annotated[IntArray, integers("L", 0, MAX_INDEX)]  # Of the pair
    time_ns: Annotated[IntArray, integers("L", 0, MAX_STAMP_NS)]  # Of the earlier state
    shift: Annotated[FloatArray, floats("LH", -1e12, 1e12)]
    gain: Annotated[FloatArray, floats("LHH", -1e12, 1e12)]
    rest: Annotated[FloatArray, floats("LHH", -1e18, 1e18)]


def _empty(table: type[TableT], sizes: dict[str, int]) -> TableT:
    stored = (hint.__metadata__[0] for hint in get_type_hints(table, include_extras=True).values())
    return table(
        *(
            np.zeros(
                [0, *(sizes[axis] for axis in each.shape[1:])],
                np.int64 if each.kind == "i" else np.float64,
            )
            for each in stored
        )
    )


def take(table: TableT, rows: Any) -> TableT:
    """Return rows of a table, by their indices, a mask or a slice."""
    return frozen(type(table)(*(column[rows] for column in table)))


def concatenate(parts: Sequence[TableT]) -> TableT:
    """Return the rows of several tables, at least one."""
    if len(parts) == 1:
        return parts[0]
    columns = map(np.concatenate, zip(*parts, strict=True))
    return frozen(type(parts[0])(*columns))


def extended(table: TableT, rows: int) -> TableT:
    """Return a copy of a table that can be written, with further rows of zeros."""
    return type(table)(
        *(
            np.concatenate([column, np.zeros((rows, *column.shape[1:]), column.dtype)])
            for column in table
        )
    )


@dataclass(frozen=True, eq=False)
class LayerState(ReadOnly):
    """Sources, pairs and tracks, and what was learned of K receivers."""

    receivers: tuple[Receiver, ...]
    # Spectral density of the tracks' acceleration, m^2/s^3.
    noise_density: float
    classes: int
    # Time in which the slowest radar looks everywhere, seconds; 0 without a radar.
    look_s: float
    sources: Sources
    pairs: Pairs
    tracks: Tracks
    links: tuple[Links, ...]  # Of pairs back to earlier scans, oldest first
    learned: Learned
    biases: Biases

    @property
    def losses(self) -> list[Losses]:
        """How each receiver loses reports."""
        found = []
        for own, counts in zip(self.receivers, self.learned.received.tolist(), strict=True):
            got, sent, observed_s, hidden_s, stretches = counts
            habits = own.habits
            lost = 1.0 - (PRIOR_REPORTS * (1.0 - own.lost) + got) / (PRIOR_REPORTS + sent)
            share = (PRIOR_S * habits.hidden + hidden_s) / (PRIOR_S + observed_s)
            long_s = (PRIOR_STRETCHES * habits.hidden_s + hidden_s) / (PRIOR_STRETCHES + stretches)
            found.append(Losses(min(max(lost, 0.001), 0.9), min(share, 0.5), long_s))
        return found

    def intervals(self, sources: Sources) -> FloatArray:
        """Return the interval of the reports of sources, seconds, (S,)."""
        covariance = sources.covariance[:, 2:4, 2:4]
        return self.intervals_of(sources.receiver, sources.mean[:, 2:4], covariance, sources.gap_s)

    def intervals_of(
        self,
        receiver: IntArray,
        velocity: FloatArray,
        covariance: FloatArray,
        gap_s: FloatArray,
    ) -> FloatArray:
        """Return the interval of the reports of transmitters with velocities, seconds, (N,).

        `receiver` is the index of each one's, `covariance` that of its velocity, and `gap_s` its
        shortest observed interval, 0 if there is none.
        """
        speed = np.hypot(*velocity.T)
        std = np.sqrt(np.einsum("nkk->n", covariance) / 2.0)
        found = np.ones(len(speed))
        for index, each in enumerate(self.receivers):
            mine = receiver == index
            # Reports of a second step can be a second nearer to each other than they were sent.
            least = np.maximum(gap_s[mine] - each.habits.time_step_s, 0.0)
            found[mine] = each.interval_of(speed[mine], std[mine], least)
        return found

    @property
    def owned(self) -> FloatArray:
        """Probability of each source that it owns any track, (S,)."""
        total = np.zeros(len(self.sources.number))
        np.add.at(total, self.sources.number.searchsorted(self.pairs.source), self.pairs.owned)
        return np.minimum(total, 1.0)


class Layer(Protocol):
    """The layer for those that hold it without compiling it; see `beside.SelfReporting`."""

    @property
    def labels(self) -> IntArray:
        """The labels whose numbers are in use beside those of the engine's targets."""

    def with_reports(self, reports: SelfReports, stamp_ns: int) -> Layer:
        """Return the layer after reports up to a stamp, in any order."""

    def places(self, stamp_ns: int) -> FloatArray:
        """Return where the reports of each source expect it at a stamp, metres, (S, 2)."""

    def after(self, rows: Rows, look: Look, seen: BoolArray) -> Layer:
        """Return the layer after a radar's look."""

    def noted(self, rows: Rows, living: IntArray, stamp_ns: int) -> Layer:
        """Return the layer after a scan."""

    def describe(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return estimates with what reports say of them."""

    def of_labels(self, oldest_ns: int) -> Layer:
        """Return the layer without links that end before a stamp."""

    def figures(self) -> dict[str, float]:
        """Return what was learned of the receivers, by dotted name."""

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the layer."""

    def restored(self, snapshot: Snapshot) -> Layer:
        """Return the stored layer; this one if the snapshot has none."""

    def changed(self, **values: Any) -> Layer:
        """Return the layer with some fields changed."""
