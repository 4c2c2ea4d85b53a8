"""The tracker's input and output values: scans in, estimates out.

Every type is frozen and its arrays are read-only, so that a later stage, such as the fixed-lag
window, can keep a value without a copy. Entries of sparse arrays, which scipy requires to be
writable, are never written to either.

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
# Track states, see `confirmation`.
TENTATIVE, CONFIRMED, COASTING = range(3)
# Marks an unknown code or address.
UNKNOWN = -1
# The columns of detections with one number per detection, and the integer columns of these.
_IDENTITIES = ("code", "address")
_WHOLE = (*_IDENTITIES, "kind")
_PER_DETECTION = (*("amplitude", "time_s", "range_rate", "range_rate_std", "height"), *_WHOLE)
# Sensor types of detections: primary radar, secondary radar, Mode S.
SENSORS = ("psr", "ssr", "mds")
# The columns of estimates with one entry per target.
_PER_TARGET = (
    *("state", "covariance", "weight", "class_probability"),
    *("class_id", "track_id", "track_state"),
)
_NOT_GIVEN: IntArray = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Coverage:
    """The azimuths that a radar's antenna swept for one report.

    Parameters
    ----------
    start : float
        First azimuth in the radar's frame, radians counter-clockwise from the x axis.
    width : float
        Extent counter-clockwise from `start`, radians; more than 0 and at most 2 pi. An antenna
        that turns clockwise sweeps it from end to start.
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
        """Share of a turn; 0 if the swept azimuths are unknown."""
        return 0.0 if self == UNKNOWN_COVERAGE else self.width / FULL_TURN


# Coverage of a report without known coverage: its detections count, but it implies no misses.
UNKNOWN_COVERAGE = Coverage(0.0, 1e-9)


@dataclass(frozen=True)
class Pose:
    """Position, heading and velocity of a sensor or its platform.

    Parameters
    ----------
    position : tuple of two floats
        In the world frame, metres.
    yaw : float
        Direction of its x axis in the world frame, radians counter-clockwise; NaN if unknown.
    velocity : tuple of two floats
        In the world frame, metres per second; zero where it is not needed.
    """

    position: tuple[float, float]
    yaw: float
    velocity: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Detections:
    """Detections of one radar in one scan, in the frame of that radar.

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
        The swept azimuths; None for the radar's whole field of view, `UNKNOWN_COVERAGE` if they are
        unknown. Detections outside the coverage are valid.
    pose : Pose or None
        Pose of the radar at the scan's stamp, to which all measurements are relative; None for the
        radar model's.
    range_rate : array of shape (M,) or None
        Metres per second relative to the radar, positive for a receding target, modulo the radar's
        ambiguity; NaN if unknown. None when the radar reports none.
    range_rate_std : array of shape (M,) or None
        Standard deviation of each range rate, metres per second; NaN, and None for all, for the
        radar model's.
    height : array of shape (M,) or None
        Above the world's zero, metres; NaN where it is unknown. None when the radar reports none.
    code, address : int array of shape (M,) or None
        Mode A code, 12 bits, and Mode S address, 24 bits, of the transponder's reply; `UNKNOWN`
        without one. None when the radar reports none.
    kind : int array of shape (M,) or None
        Sensor type, the TYP of I048/020: 1 primary, 2 secondary, 3 both, 4 and 5 Mode S, 6 and 7
        Mode S and primary; `UNKNOWN` otherwise. None when the radar reports none.
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
    """All detections with a common stamp.

    Parameters
    ----------
    stamp_ns : int
        Time of the scan in nanoseconds.
    detections : tuple of (Detections or None), one entry per radar, in the configured order
        None if that radar did not report at this stamp. The filter is then not updated with it,
        which differs from an update with zero detections.
    """

    stamp_ns: int
    detections: tuple[Detections | None, ...]


@dataclass(frozen=True)
class Attributes:
    """Heights and identities of targets, in addition to their states.

    Parameters
    ----------
    height : array of shape (T, 2)
        Above the world's zero and climb rate, metres and metres per second; NaN where unknown.
    height_covariance : array of shape (T, 2, 2)
        NaN where unknown.
    code, address : int arrays of shape (T,)
        Mode A code and Mode S address; `UNKNOWN` if there is none or none is probable enough.
    seen_ns : int array of shape (T, S) or None
        Time of the last detection by each of `SENSORS`, nanoseconds; `UNKNOWN` for never. None if
        no radar reports sensor types, and in smoothed estimates.
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
        """Concatenate the attributes of several sets of targets, at least one."""
        return Attributes(
            np.concatenate([part.height for part in parts]),
            np.concatenate([part.height_covariance for part in parts]),
            np.concatenate([part.code for part in parts]),
            np.concatenate([part.address for part in parts]),
            Attributes._seen(parts),
        )

    @staticmethod
    def _seen(parts: Sequence[Attributes]) -> IntArray | None:
        """Concatenate the detection times of several sets of targets; None if no set has any."""
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
        """Return unknown attributes for `count` targets."""
        none = np.full(count, UNKNOWN)
        return Attributes(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), none, none)

    def take(self, rows: IntArray) -> Attributes:
        """Return the attributes of the targets of these rows."""
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
        Number of later scans used in the estimates; 0 for filtered ones.
    state : array of shape (T, D)
        In the world frame; metres, metres per second, radians per second.
    covariance : array of shape (T, D, D)
        Covariance of the state, in the same units.
    weight : array of shape (T,)
        Existence probability of the target: the mass of its component; biased with the PHD filter.
    class_probability : array of shape (T, C)
    class_id : int array of shape (T,)
    track_id : int array of shape (T,)
        0 means unlabelled.
    space : StateSpace
        What the axes of the states are.
    track_state : int array of shape (T,)
        `TENTATIVE`, `CONFIRMED` or `COASTING`; by default all are confirmed.
    attributes : Attributes or None
        Heights and identities; None if no radar reports any.
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
        """Concatenate estimates of several stamps; return them by ascending track, with each stamp.

        At least one part is required. The result has the stamp of the last part.
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
        """Number of estimates with the mass of two or more unresolved targets."""
        return int(np.count_nonzero(self.weight > 1.5))


FILTERED, SMOOTHED = SOURCES = ("filtered", "smoothed")


@dataclass(frozen=True)
class Truth:
    """The targets that exist at one stamp.

    Parameters
    ----------
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
