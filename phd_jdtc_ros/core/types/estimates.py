"""Estimates of targets with their heights and identities, and the truth: the tracker's output."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Annotated

import numpy as np

from ..arrays import UNKNOWN, BoolArray, FloatArray, IntArray, ReadOnly, read_only
from ..snapshot import MAX_MASS, MAX_STATE, covariances, floats, integers
from ..state_space import PLANAR, StateSpace
from .detections import SENSORS
from .reports import Reported

# Track states, see `confirmation`.
TENTATIVE, CONFIRMED, COASTING = range(3)
TRACK_STATES = ("tentative", "confirmed", "coasting")
# The columns of estimates with one entry per target.
_PER_TARGET = (
    *("state", "covariance", "weight", "class_probability"),
    *("class_id", "track_id", "track_state"),
)
_per_target = attrgetter(*_PER_TARGET)
# The columns of attributes with one entry per target, without the detection times.
_PER_ATTRIBUTE = ("height", "height_covariance", "code", "address")
_NOT_GIVEN: IntArray = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Attributes(ReadOnly):
    """Heights and identities of targets, in addition to their states."""

    # Height above the world's zero and climb rate, metres and metres per second, (T, 2); NaN where
    # unknown.
    height: FloatArray
    height_covariance: FloatArray  # NaN where unknown, (T, 2, 2)
    # Mode A code, (T,); `UNKNOWN` if there is none or none is probable enough.
    code: IntArray
    # Mode S address, (T,); `UNKNOWN` if there is none or none is probable enough.
    address: IntArray
    # Time of the last detection by each of `SENSORS`, nanoseconds, (T, S); `UNKNOWN` for never.
    # None if no radar reports detection types, and in smoothed estimates.
    seen_ns: IntArray | None = None

    @staticmethod
    def concatenate(parts: Sequence[Attributes]) -> Attributes:
        """Concatenate the attributes of several sets of targets, at least one.

        If no set has detection times, the result has none; otherwise they are `UNKNOWN` for the
        targets of a set without them.
        """
        columns = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in _PER_ATTRIBUTE
        }
        if any(part.seen_ns is not None for part in parts):
            never = (np.full((len(part.code), len(SENSORS)), UNKNOWN) for part in parts)
            seen = (
                none if part.seen_ns is None else part.seen_ns
                for part, none in zip(parts, never, strict=True)
            )
            columns["seen_ns"] = np.concatenate([*seen])
        return Attributes(**columns)

    @staticmethod
    def unknown(count: int) -> Attributes:
        """Return unknown attributes for `count` targets."""
        none = np.full(count, UNKNOWN)
        return Attributes(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), none, none)

    def take(self, rows: IntArray | slice) -> Attributes:
        """Return the attributes of the targets of these rows."""
        columns = {name: getattr(self, name)[rows] for name in _PER_ATTRIBUTE}
        return Attributes(**columns, seen_ns=None if self.seen_ns is None else self.seen_ns[rows])

    def ages_s(self, time_ns: int) -> FloatArray:
        """Return the times since the detections in `seen_ns`, (T, S); NaN for never or unknown."""
        if self.seen_ns is None:
            return np.full((len(self.code), len(SENSORS)), np.nan)
        ages: FloatArray = np.maximum(time_ns - self.seen_ns, 0) * 1e-9
        ages[self.seen_ns == UNKNOWN] = np.nan
        return ages


class _Targets(ReadOnly):
    """Positions and velocities of states in the world frame."""

    state: FloatArray
    space: StateSpace

    @cached_property
    def position(self) -> FloatArray:
        """Positions in the world frame, metres, shape (T, 2)."""
        position: FloatArray = read_only(self.state[:, list(self.space.position)])
        return position

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities in the world frame, metres per second, shape (T, 2)."""
        velocity: FloatArray = read_only(self.state[:, list(self.space.velocity)])
        return velocity


@dataclass(frozen=True)
class Estimates(_Targets):
    """Targets extracted from an intensity."""

    stamp_ns: int  # Time of the states
    lag: int  # Number of later scans used in the estimates; 0 for filtered ones
    # World frame; metres, metres per second, radians per second, (T, D).
    state: Annotated[FloatArray, floats("TD", -MAX_STATE, MAX_STATE)]
    # Covariance of the state, in the same units, (T, D, D).
    covariance: Annotated[FloatArray, covariances("TDD", MAX_STATE)]
    # Existence probability of the target, which is the mass of its component, (T,). That of the PHD
    # filter is biased.
    weight: Annotated[FloatArray, floats("T", 0.0, MAX_MASS)]
    class_probability: Annotated[FloatArray, floats("TC", 0.0, MAX_MASS)]  # (T, C)
    class_id: Annotated[IntArray, integers("T", 0, below="C")]  # (T,)
    # Track number, from 1, (T,); 0 for an estimate without a label. Within an engine, before
    # `TrackNumbers.assign`, it is the label + 1.
    track_id: Annotated[IntArray, integers("T", 0)]
    space: StateSpace = PLANAR  # Axes of the states
    # `TENTATIVE`, `CONFIRMED` or `COASTING`, (T,); by default all are confirmed.
    track_state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)] = field(
        default_factory=lambda: _NOT_GIVEN
    )
    attributes: Attributes | None = None  # Heights and identities; None if no radar reports any
    # Pressure altitude of targets in space minus their height, metres; NaN if it is not known.
    pressure_above: float = math.nan
    reports: Reported | None = None  # What self-reports say; None without a receiver of them
    # If several trackers contribute: the index of the tracker whose estimate it is, and the number
    # of the track in each of the K trackers, 0 if it has none, (T, 1 + K). None for one tracker.
    members: IntArray | None = None

    @property
    def position_covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (T, 2, 2)."""
        return self._covariance_of(self.space.position)

    @property
    def velocity_covariance(self) -> FloatArray:
        """Covariances of the velocities, (m/s)^2, shape (T, 2, 2)."""
        return self._covariance_of(self.space.velocity)

    @property
    def covariance_in_space(self) -> FloatArray:
        """Covariances of x, y, z and their velocities, (T, 6, 6); NaN for unknown heights.

        A height beside the state has no covariance with the plane.
        """
        height = self.known_attributes.height_covariance
        joint = np.zeros((len(self), 6, 6))
        axes = [0, 1, 3, 4, *((2, 5) if self.space.vertical else ())]
        of_state = [*self.space.position, *self.space.velocity, *self.space.vertical]
        joint[:, np.array(axes)[:, None], axes] = self._covariance_of(tuple(of_state))
        joint[:, [[2], [5]], [2, 5]] = height
        unknown = np.isnan(height[:, 0, 0])
        joint[unknown, 2] = joint[unknown, 5] = np.nan
        joint[unknown, :, 2] = joint[unknown, :, 5] = np.nan
        return joint

    @cached_property
    def known_attributes(self) -> Attributes:
        """Heights and identities, all of which are unknown if no radar reports any."""
        return self.attributes or Attributes.unknown(len(self))

    def _covariance_of(self, axes: tuple[int, ...]) -> FloatArray:
        return self.covariance[:, axes][:, :, axes]

    def __post_init__(self) -> None:
        if self.track_state is _NOT_GIVEN:
            object.__setattr__(self, "track_state", np.full(len(self.weight), CONFIRMED))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.state)

    def with_heights(self, largest_std: float) -> Estimates:
        """Return estimates in space with their heights and climb rates as attributes.

        Heights with a standard deviation above `largest_std`, metres, are unknown.
        """
        axes, found = self.space.vertical, self.known_attributes
        height, covariance = self.state[:, axes].copy(), self._covariance_of(axes).copy()
        unknown = ~(covariance[:, 0, 0] <= largest_std**2)
        height[unknown], covariance[unknown] = np.nan, np.nan
        return self.changed(attributes=found.changed(height=height, height_covariance=covariance))

    def with_pressure(self, above: float, std: float) -> Estimates:
        """Return estimates in space whose heights follow from pressure altitudes.

        Pressure altitudes are `above` metres larger, with a standard deviation that all heights
        have in common.
        """
        (z, _), covariance = self.space.vertical, self.covariance.copy()
        covariance[:, z, z] += std**2
        return self.changed(covariance=covariance, pressure_above=above)

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, which `weight` is, (T,)."""
        return self.weight

    def take(self, rows: IntArray | slice) -> Estimates:
        """Return the estimates of these rows."""
        values = self.__dict__
        columns = {name: values[name][rows] for name in _PER_TARGET}
        attributes = None if self.attributes is None else self.attributes.take(rows)
        reports = None if self.reports is None else self.reports.take(rows)
        members = None if self.members is None else self.members[rows]
        return self.changed(attributes=attributes, reports=reports, members=members, **columns)

    def select(self, mask: BoolArray) -> Estimates:
        """Return the estimates that a mask selects: these themselves if it selects all."""
        (rows,) = mask.nonzero()
        return self if rows.size == mask.size else self.take(rows)

    @staticmethod
    def concatenate(parts: Sequence[Estimates], lag: int) -> tuple[Estimates, IntArray]:
        """Concatenate estimates of several stamps; return them by ascending track, with each stamp.

        At least one part is required. The result has the stamp of the last part.
        """
        sizes = [part.weight.size for part in parts]
        stamps = np.array([part.stamp_ns for part in parts]).repeat(sizes)
        if len(parts) == 1:
            return parts[0], stamps
        order = np.concatenate([part.track_id for part in parts]).argsort(kind="stable")
        columns = zip(*map(_per_target, parts), strict=True)
        joined = [np.concatenate(column)[order] for column in columns]
        known = [part.attributes for part in parts if part.attributes is not None]
        said = [part.reports for part in parts if part.reports is not None]
        named = dict(zip(_PER_TARGET, joined, strict=True))
        attributes, reports = None, None
        if len(known) == len(parts):
            attributes = Attributes.concatenate(known).take(order)
        if len(said) == len(parts):
            reports = Reported.concatenate(said).take(order)
        others = {"attributes": attributes, "reports": reports, "members": None}
        return parts[-1].changed(lag=lag, **others, **named), stamps[order]

    def with_rows(self, others: Estimates) -> Estimates:
        """Return these estimates and others of the same stamp, after them."""
        columns = zip(_per_target(self), _per_target(others), strict=True)
        named = dict(zip(_PER_TARGET, map(np.concatenate, columns), strict=True))
        attributes, reports = None, None
        if self.attributes is not None and others.attributes is not None:
            attributes = Attributes.concatenate([self.attributes, others.attributes])
        if self.reports is not None and others.reports is not None:
            reports = Reported.concatenate([self.reports, others.reports])
        return self.changed(attributes=attributes, reports=reports, members=None, **named)

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
class Truth(_Targets):
    """The targets that exist at one stamp."""

    stamp_ns: int
    state: FloatArray  # (T, D)
    track_id: IntArray  # Counted from 1 in the order of the scenario, (T,)
    class_id: IntArray  # (T,)
    space: StateSpace = PLANAR  # Axes of the states
    # Height and climb rate, metres and metres per second, (T, 2); None if unknown.
    height: FloatArray | None = None
