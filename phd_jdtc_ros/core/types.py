"""Values that pass through the tracker: scans in, estimates out.

Every type is frozen and its arrays are read-only, so a later stage can keep a value without a copy,
as the fixed-lag window does. The entries of sparse arrays, which scipy requires to be writable, are
never written to either.

Dimension letters, the same everywhere: N particles, M detections, J components,
T targets, O modes, C classes, D state, Z measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from .arrays import FloatArray, IntArray, read_only
from .snapshot import MASS_SLACK, MOST_STATE, covariances, floats, integers
from .state_space import PLANAR, StateSpace

FULL_TURN = 2.0 * np.pi
# States of a track, see `confirmation`.
TENTATIVE, CONFIRMED, COASTING = range(3)
# A code or an address that is not known.
UNKNOWN = -1
# The columns of detections that have one number for each, and those of them that are whole numbers.
_IDENTITIES = ("code", "address")
_WHOLE = (*_IDENTITIES, "kind")
_PER_DETECTION = (*("amplitude", "time_s", "range_rate", "range_rate_std", "height"), *_WHOLE)
# Kinds of sensors that see targets: primary and secondary radar, and Mode S.
SENSORS = ("psr", "ssr", "mds")
# The columns of estimates that have an entry for each target.
_PER_TARGET = (
    *("state", "covariance", "weight", "class_probability"),
    *("class_id", "track_id", "track_state"),
)
_NOT_GIVEN: IntArray = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Coverage:
    """The azimuths that a radar's antenna passed for one report.

    Parameters
    ----------
    start : float
        Where it begins, in the radar's frame, radians counter-clockwise from the x axis.
    width : float
        Its extent counter-clockwise from there, radians; more than 0 and at most 2 pi. An antenna
        that turns clockwise passes it from its end to its start.
    """

    start: float
    width: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.start) and 0.0 < self.width <= FULL_TURN):
            raise ValueError(
                f"coverage: start {self.start}, width {self.width}, expected a finite start and a "
                "width above 0 and at most 2 pi"
            )

    @property
    def turns(self) -> float:
        """Its share of a turn; 0 where nobody knows what the antenna passed."""
        return 0.0 if self == UNKNOWN_COVERAGE else self.width / FULL_TURN


# Of a report that does not say what was missed: all that it has is where its detections are.
UNKNOWN_COVERAGE = Coverage(0.0, 1e-9)


@dataclass(frozen=True)
class Pose:
    """Where a sensor, or what carries it, is and how it is turned.

    Parameters
    ----------
    position : tuple of two floats
        In the world frame, metres.
    yaw : float
        Direction of its x axis in the world frame, radians counter-clockwise; NaN if it is not
        known.
    velocity : tuple of two floats
        In the world frame, metres per second; zero where nobody needs it.
    """

    position: tuple[float, float]
    yaw: float
    velocity: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Detections:
    """What one radar reports in one scan, in that radar's own frame.

    Parameters
    ----------
    measurement : array of shape (M, Z)
        For the polar radar Z = 2: range in metres, azimuth in radians counter-clockwise from the
        sensor's x axis.
    amplitude : array of shape (M,) or None
        Linear envelope in units of the noise's per-quadrature standard deviation. NaN where it is
        unknown. None when the radar reports no amplitude: the class likelihood is then neutral.
    time_s : array of shape (M,) or None
        Time of each detection relative to the scan's stamp, seconds; None if all are at the stamp.
    noise_std : array of shape (M, Z) or None
        Standard deviations of each detection, in the units of the measurement; None for the radar
        model's.
    coverage : Coverage or None
        The azimuths that the antenna passed; None for the radar's whole field, `UNKNOWN_COVERAGE`
        where that is not known. Detections elsewhere are none the less detections.
    pose : Pose or None
        Of the radar at the scan's stamp, which all measurements are relative to; None for the
        radar model's.
    range_rate : array of shape (M,) or None
        Metres per second relative to the radar, positive where a target recedes; modulo the radar's
        ambiguity. NaN where it is unknown. None when the radar reports none.
    range_rate_std : array of shape (M,) or None
        Standard deviation of each range rate, metres per second; NaN, and None for all, for the
        radar model's.
    height : array of shape (M,) or None
        Above the world's zero, metres; NaN where it is unknown. None when the radar reports none.
    code, address : int array of shape (M,) or None
        Mode A code, 12 bits, and Mode S address, 24 bits, of the transponder that answered;
        `UNKNOWN` where there is none. None when the radar reports none.
    kind : int array of shape (M,) or None
        What saw it, the TYP of I048/020: 1 primary, 2 secondary, 3 both, 4 and 5 Mode S, 6 and 7
        Mode S and primary; `UNKNOWN` otherwise. None when the radar does not say.
    """

    measurement: FloatArray
    amplitude: FloatArray | None
    time_s: FloatArray | None = None
    noise_std: FloatArray | None = None
    coverage: Coverage | None = None
    pose: Pose | None = None
    range_rate: FloatArray | None = None
    range_rate_std: FloatArray | None = None
    height: FloatArray | None = None
    code: IntArray | None = None
    address: IntArray | None = None
    kind: IntArray | None = None

    def __post_init__(self) -> None:
        measurement = read_only(self.measurement)
        if measurement.ndim != 2:
            raise ValueError(f"measurement: expected shape (M, Z), got {measurement.shape}")
        object.__setattr__(self, "measurement", measurement)
        for name in (*_PER_DETECTION, "noise_std"):
            value = getattr(self, name)
            if value is None:
                continue
            value = read_only(value, np.int64) if name in _WHOLE else read_only(value)
            shape = measurement.shape if name == "noise_std" else measurement.shape[:1]
            if value.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {value.shape}")
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.measurement)

    def take(self, rows: IntArray) -> Detections:
        """Return the detections of these rows, in this order; coverage and pose stay the same."""
        columns = {
            name: getattr(self, name)[rows]
            for name in ("measurement", "noise_std", *_PER_DETECTION)
            if getattr(self, name) is not None
        }
        return replace(self, **columns)


@dataclass(frozen=True)
class Scan:
    """All detections that carry one stamp.

    Parameters
    ----------
    stamp_ns : int
        Time of the scan in nanoseconds.
    detections : tuple of (Detections or None), one entry per radar, in the configured order
        None if that radar did not report this stamp. There is then no update with it, which is
        not the same as an update with zero detections.
    """

    stamp_ns: int
    detections: tuple[Detections | None, ...]


@dataclass(frozen=True)
class Attributes:
    """What is known of targets beside their states.

    Parameters
    ----------
    height : array of shape (T, 2)
        Above the world's zero and climb rate, metres and metres per second; NaN where unknown.
    height_covariance : array of shape (T, 2, 2)
        NaN where unknown.
    code, address : int arrays of shape (T,)
        Mode A code and Mode S address; `UNKNOWN` where there is none or none is probable enough.
    seen_ns : int array of shape (T, S) or None
        When each of `SENSORS` last saw the target, nanoseconds; `UNKNOWN` for never. None where no
        radar says what saw its detections, and in smoothed estimates.
    """

    height: FloatArray
    height_covariance: FloatArray
    code: IntArray
    address: IntArray
    seen_ns: IntArray | None = None

    def __post_init__(self) -> None:
        for name in ("height", "height_covariance"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in (*_IDENTITIES, *(() if self.seen_ns is None else ("seen_ns",))):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    @staticmethod
    def joined(parts: Sequence[Attributes]) -> Attributes:
        """Return those of several sets of targets, one after the other; there must be one set."""
        return Attributes(
            np.concatenate([part.height for part in parts]),
            np.concatenate([part.height_covariance for part in parts]),
            np.concatenate([part.code for part in parts]),
            np.concatenate([part.address for part in parts]),
            Attributes._seen(parts),
        )

    @staticmethod
    def _seen(parts: Sequence[Attributes]) -> IntArray | None:
        """Return the times of several sets of targets; None where none of them has any."""
        if all(part.seen_ns is None for part in parts):
            return None
        return np.concatenate(
            [
                np.full((len(part.code), len(SENSORS)), UNKNOWN)
                if part.seen_ns is None
                else part.seen_ns
                for part in parts
            ]
        )

    @staticmethod
    def unknown(count: int) -> Attributes:
        """Return those of so many targets of which nothing is known."""
        none = np.full(count, UNKNOWN)
        return Attributes(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), none, none)

    def take(self, rows: IntArray) -> Attributes:
        """Return those of some targets."""
        return Attributes(
            self.height[rows],
            self.height_covariance[rows],
            self.code[rows],
            self.address[rows],
            None if self.seen_ns is None else self.seen_ns[rows],
        )


@dataclass(frozen=True)
class Estimates:
    """Targets extracted from an intensity.

    Parameters
    ----------
    stamp_ns : int
        Time of the states in nanoseconds.
    lag : int
        Number of later scans that the estimates take into account; 0 for filtered ones.
    state : array of shape (T, D)
        In the world frame; metres, metres per second, radians per second.
    covariance : array of shape (T, D, D)
        Of the target's density about the state, in the same units.
    weight : array of shape (T,)
        Mass of the component: the probability that the target exists; biased if the filter is the
        PHD filter.
    class_probability : array of shape (T, C)
    class_id : int array of shape (T,)
    track_id : int array of shape (T,)
        0 means unlabelled.
    space : StateSpace
        What the axes of the states are.
    track_state : int array of shape (T,)
        `TENTATIVE`, `CONFIRMED` or `COASTING`; all are confirmed if it is not given.
    attributes : Attributes or None
        Heights and identities; None where no radar reports any.
    """

    stamp_ns: int
    lag: int
    state: Annotated[FloatArray, floats("TD", -MOST_STATE, MOST_STATE)]
    covariance: Annotated[FloatArray, covariances("TDD", MOST_STATE)]
    weight: Annotated[FloatArray, floats("T", 0.0, MASS_SLACK)]
    class_probability: Annotated[FloatArray, floats("TC", 0.0, MASS_SLACK)]
    class_id: Annotated[IntArray, integers("T", 0, below="C")]
    track_id: Annotated[IntArray, integers("T", 0)]
    space: StateSpace = PLANAR
    track_state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)] = field(
        default_factory=lambda: _NOT_GIVEN
    )
    attributes: Attributes | None = None

    @property
    def position(self) -> FloatArray:
        """Positions in the world frame, metres, shape (T, 2)."""
        return self.state[:, list(self.space.position)]

    @property
    def velocity(self) -> FloatArray:
        """Velocities in the world frame, metres per second, shape (T, 2)."""
        return self.state[:, list(self.space.velocity)]

    @property
    def position_covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (T, 2, 2)."""
        axes = list(self.space.position)
        return self.covariance[:, axes][:, :, axes]

    def __post_init__(self) -> None:
        for name in ("state", "covariance", "weight", "class_probability"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        if self.track_state is _NOT_GIVEN:
            object.__setattr__(self, "track_state", np.full(len(self), CONFIRMED))
        for name in ("class_id", "track_id", "track_state"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.state)

    def take(self, rows: IntArray) -> Estimates:
        """Return the estimates of these rows."""
        columns = {name: getattr(self, name)[rows] for name in _PER_TARGET}
        known = None if self.attributes is None else self.attributes.take(rows)
        return replace(self, attributes=known, **columns)

    @staticmethod
    def concatenate(parts: Sequence[Estimates], lag: int) -> tuple[Estimates, IntArray]:
        """Return estimates of several stamps as one, by ascending track, and the stamp of each.

        There must be one part at least. The stamp of the whole is that of the last part.
        """
        stamps = np.repeat([part.stamp_ns for part in parts], [len(part) for part in parts])
        if len(parts) == 1:
            return parts[0], stamps
        order = np.argsort(np.concatenate([part.track_id for part in parts]), kind="stable")
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts])[order]
            for name in _PER_TARGET
        }
        known = [part.attributes for part in parts if part.attributes is not None]
        attributes = Attributes.joined(known).take(order) if len(known) == len(parts) else None
        last = parts[-1]
        return replace(last, lag=lag, attributes=attributes, **columns), stamps[order]

    @staticmethod
    def empty(stamp_ns: int, lag: int, classes: int, space: StateSpace = PLANAR) -> Estimates:
        """Return estimates of no targets."""
        size, no_one = len(space), np.zeros(0, dtype=np.int64)
        return Estimates(
            stamp_ns=stamp_ns,
            lag=lag,
            state=np.zeros((0, size)),
            covariance=np.zeros((0, size, size)),
            weight=np.zeros(0),
            class_probability=np.zeros((0, classes)),
            class_id=no_one,
            track_id=no_one,
            space=space,
        )

    @property
    def unresolved(self) -> int:
        """Number of estimates with the mass of two targets that were not resolved."""
        return int(np.count_nonzero(self.weight > 1.5))


FILTERED, SMOOTHED = SOURCES = ("filtered", "smoothed")


@dataclass(frozen=True)
class Truth:
    """The targets that exist at one stamp.

    Parameters
    ----------
    stamp_ns : int
    state : array of shape (T, D)
    track_id : int array of shape (T,)
        Counted from 1 in the order of the scenario.
    class_id : int array of shape (T,)
    space : StateSpace
        What the axes of the states are.
    height : array of shape (T, 2) or None
        Height and climb rate, metres and metres per second; None if they are not known.
    """

    stamp_ns: int
    state: FloatArray
    track_id: IntArray
    class_id: IntArray
    space: StateSpace = PLANAR
    height: FloatArray | None = None

    @property
    def position(self) -> FloatArray:
        """Positions in the world frame, metres, shape (T, 2)."""
        return self.state[:, list(self.space.position)]

    @property
    def velocity(self) -> FloatArray:
        """Velocities in the world frame, metres per second, shape (T, 2)."""
        return self.state[:, list(self.space.velocity)]

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", read_only(self.state))
        if self.height is not None:
            object.__setattr__(self, "height", read_only(self.height))
        for name in ("track_id", "class_id"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
