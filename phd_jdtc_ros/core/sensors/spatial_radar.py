"""A radar that measures slant ranges and azimuths of targets in space, and mostly elevations.

A detection without an elevation has the elevation 0 with the standard deviation `UNKNOWN_STD`, and
its density counts as uniform over the elevations of the field of view: targets, false detections
and births have the same factor, so that all detections keep three components.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, cast

import numpy as np

from ..arrays import FloatArray, IntArray, read_only
from ..state_space import SPATIAL, StateSpace
from ..types import LEVEL, Detections, Pose, rotation_of
from .gaussians import UNKNOWN_STD, Births, HeightPrior, Heights, PlanePlots
from .of_gaussians.linearised import Linearised
from .polar_geometry import MIN_RANGE
from .polar_radar import RadarModel
from .range_rate import Rates, Velocities


def linearise(
    position: FloatArray, origin: FloatArray, yaw: float, curvature: float
) -> tuple[FloatArray, FloatArray]:
    """Return (range, azimuth, elevation) of places, (..., 3), and their Jacobians, (..., 3, 3).

    `origin` is the place of the antenna, `yaw` the direction of its x axis, radians
    counter-clockwise, and `curvature` that of the earth, one over its radius in metres.

    Notes
    -----
    A place at the distance d along the ground and the height h above the antenna is seen at the
    level distance u and at w above the antenna's horizon, from which range and elevation follow.
    Over a plane u = d and w = h. On a sphere of the radius R, u = (R + h) sin(d / R) and
    w = h - 2 (R + h) sin^2(d / 2R).
    """
    line = position - origin
    east, north, height = line[..., 0], line[..., 1], line[..., 2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead, left = cos * east + sin * north, cos * north - sin * east
    level = np.maximum(np.hypot(ahead, left), MIN_RANGE)
    angle, stretch = curvature * level, 1.0 + curvature * height
    # Without a curvature R sin(d / R) is the distance d, and the drop below the horizon vanishes.
    arc = level * np.sinc(angle / np.pi)
    half = 0.5 * level * np.sinc(0.5 * angle / np.pi)
    u, w = stretch * arc, height - 2.0 * stretch * curvature * half**2
    slant = np.maximum(np.hypot(u, w), MIN_RANGE)
    u_d, w_d = stretch * np.cos(angle), -stretch * np.sin(angle)
    u_h, w_h = np.sin(angle), np.cos(angle)
    r_d, r_h = (u * u_d + w * w_d) / slant, (u * u_h + w * w_h) / slant
    e_d, e_h = (u * w_d - w * u_d) / slant**2, (u * w_h - w * u_h) / slant**2
    along, across = east / level, north / level
    measured, jacobian = np.empty(position.shape), np.zeros((*position.shape, 3))
    measured[..., 0], measured[..., 1] = slant, np.arctan2(left, ahead)
    measured[..., 2] = np.arctan2(w, u)
    jacobian[..., 0, 0], jacobian[..., 0, 1], jacobian[..., 0, 2] = (
        r_d * along,
        r_d * across,
        r_h,
    )
    jacobian[..., 1, 0], jacobian[..., 1, 1] = -across / level, along / level
    jacobian[..., 2, 0], jacobian[..., 2, 1], jacobian[..., 2, 2] = (
        e_d * along,
        e_d * across,
        e_h,
    )
    return measured, jacobian


def sides(measured: FloatArray) -> FloatArray:
    """Return places in the frame of range, azimuth and elevation, (..., 3)."""
    distance, azimuth, elevation = np.moveaxis(measured, -1, 0)
    level = distance * np.cos(elevation)
    up = distance * np.sin(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=-1)


def _slopes(measured: FloatArray) -> FloatArray:
    """Return the Jacobians of `sides`, (..., 3, 3)."""
    distance, azimuth, elevation = np.moveaxis(measured, -1, 0)
    (cos, sin), (level, up) = ((np.cos(a), np.sin(a)) for a in (azimuth, elevation))
    none = np.zeros_like(distance)
    rows = (
        (level * cos, -distance * level * sin, -distance * up * cos),
        (level * sin, distance * level * cos, -distance * up * sin),
        (up, none, distance * level),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def seen_at(place: FloatArray) -> FloatArray:
    """Return range, azimuth and elevation of places, (..., 3); the inverse of `sides`."""
    x, y, z = np.moveaxis(place, -1, 0)
    level = np.hypot(x, y)
    return np.stack([np.hypot(level, z), np.arctan2(y, x), np.arctan2(z, level)], axis=-1)


def turned(measured: FloatArray, turn: FloatArray) -> FloatArray:
    """Return range, azimuth and elevation, (..., 3), in a frame that a rotation leads to."""
    seen = seen_at(sides(measured) @ turn.T)
    seen[..., 0] = measured[..., 0]
    return seen


@dataclass(frozen=True, kw_only=True)
class SpatialRadar(RadarModel):
    """A radar that measures range, azimuth and elevation of places (x, y, z).

    With a `curvature` the world is a sphere in the plane's coordinates: distances along the ground
    are arcs, and heights are above it.
    """

    components: ClassVar[tuple[str, ...]] = ("range", "azimuth", "elevation")

    space: StateSpace = SPATIAL
    height: float  # Of the antenna, world frame, metres
    climb: float = 0.0  # Of the antenna, metres per second
    # Standard deviation of elevations, radians; `UNKNOWN_STD` for a radar without elevations.
    elevation_std: float
    height_prior: HeightPrior  # Of targets that are born at detections without an elevation
    curvature: float = 0.0  # Of the earth, one over the radius in metres
    # Pitch, by which the array's x axis points up, and then roll, by which its left side is up,
    # radians. Azimuths and elevations are in the array's frame.
    tilt: tuple[float, float] = LEVEL

    @cached_property
    def turn(self) -> FloatArray:
        """Rotation from the level frame to the array's, (3, 3); (0, 3) for a level array."""
        return np.zeros((0, 3)) if self.tilt == LEVEL else rotation_of(0.0, self.tilt).T

    def at(self, pose: Pose | None) -> SpatialRadar:
        """Return the radar at a pose; None keeps its pose."""
        placed = super().at(pose)
        if pose is None:
            return placed
        return placed.changed(height=pose.height, climb=pose.climb, tilt=pose.tilt)

    @property
    def pose(self) -> Pose:
        """Its pose at rest."""
        return Pose(self.position, self.yaw, height=self.height, tilt=self.tilt)

    def with_scaled_noise(self, of_std: FloatArray) -> SpatialRadar:
        """Return the radar with deviations of its noise multiplied by factors; see `Sensor`."""
        scaled = self.changed(elevation_std=float(of_std[2]) * self.elevation_std)
        return cast(SpatialRadar, RadarModel.with_scaled_noise(scaled, of_std[[0, 1, 3]]))

    @cached_property
    def of_gaussians(self) -> Linearised:
        """Its measurements of Gaussians, compiled; see `RadarModel`."""
        from .of_gaussians.spatial import SpatialGaussians

        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        pose = np.array([*self.position, self.height, cos, sin, self.curvature])
        return SpatialGaussians(self, pose, self.turn)

    @property
    def origin(self) -> FloatArray:
        """Place and velocity of the antenna, metres and metres per second, (2, 3)."""
        return np.array([[*self.position, self.height], [*self.velocity, self.climb]])

    @cached_property
    def noise_std(self) -> FloatArray:
        """Standard deviations of (range, azimuth, elevation), (3,)."""
        std: FloatArray = read_only([self.range_std, self.azimuth_std, self.elevation_std])
        return std

    def log_correction(self, elevation_std: FloatArray) -> FloatArray:
        """Return what makes the log densities of unknown elevations uniform, (M,)."""
        uniform = math.log(UNKNOWN_STD * math.sqrt(2.0 * math.pi) / self.visibility.elevation_width)
        correction: FloatArray = np.where(elevation_std >= UNKNOWN_STD, uniform, 0.0)
        return correction

    def linearise(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return measurements of places, (..., 3), and their Jacobians; see `linearise`."""
        measured, jacobian = linearise(position, self.origin[0], self.yaw, self.curvature)
        if not len(self.turn):
            return measured, jacobian
        seen = turned(measured, self.turn)
        slopes: FloatArray = np.linalg.inv(_slopes(seen)) @ self.turn @ _slopes(measured)
        return seen, slopes @ jacobian

    def measure(self, state: FloatArray) -> FloatArray:
        """Return noise-free measurements of each state; shape (N, D) to (N, 3)."""
        return self.linearise(state[:, list(self.space.place)])[0]

    def _on_ground(self, slant: FloatArray, sine: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return distances along the ground and heights, given the sines of elevations."""
        u, w = slant * np.sqrt(np.maximum(1.0 - sine**2, 0.0)), slant * sine
        if not self.curvature:
            return u, w + self.height
        radius = 1.0 / self.curvature
        # R (sqrt(1 + e) - 1) without the difference of large numbers.
        excess = (2.0 * w * radius + w**2 + u**2) / radius**2
        above = radius * excess / (np.sqrt(1.0 + excess) + 1.0)
        return radius * np.arctan2(u, radius + w), above + self.height

    def to_world(self, measurement: FloatArray) -> FloatArray:
        """Return the places of measurements, metres, (M, 3); at the elevation 0 without one."""
        if measurement.shape[1] < len(self.components):
            measurement = np.pad(measurement, ((0, 0), (0, 1)))
        if len(self.turn):
            measurement = turned(measurement, self.turn.T)
        slant, azimuth, elevation = measurement.T
        level, height = self._on_ground(slant, np.sin(elevation))
        level = np.where(np.cos(elevation) < 0.0, -level, level)
        bearing = azimuth + self.yaw
        east, north = level * np.cos(bearing), level * np.sin(bearing)
        return np.stack([self.position[0] + east, self.position[1] + north, height], axis=1)

    def motion_of(self, detections: Detections) -> Rates | Velocities | None:
        """Return the range rates of detections; None without usable ones.

        The noise of those without an elevation and a height includes what climbs at the heights of
        undetected targets can add. Height and climb rate are then hardly known, and their product
        differs from its linearisation by the same error in all looks. As the error of single looks
        it would be averaged, and heights that nothing has shown would seem to be known.
        """
        rates = super().motion_of(detections)
        if not isinstance(rates, Rates):
            return rates
        unknown = self.noise_std_of(detections)[:, 2] >= UNKNOWN_STD
        if detections.z is not None:
            unknown &= ~np.isfinite(detections.z)
        prior, slant = self.height_prior, np.maximum(detections.measurement[:, 0], MIN_RANGE)
        steepest = np.abs(np.sin(self.visibility.elevation_limits)).max()
        rise = np.minimum(math.hypot(prior.mean - self.height, prior.std) / slant, steepest)
        climbing = np.where(unknown, rise * rates.model.climb_std, 0.0)
        return rates._replace(std=np.hypot(rates.std, climbing))

    def in_plane(self, detections: Detections) -> PlanePlots:
        """Return detections as places with covariances, at their own times.

        The errors are along the line of sight, across it, and upward.
        """
        measured, std = detections.measurement, self.noise_std_of(detections)
        bearing, elevation = measured[:, 1] + self.yaw, measured[:, 2]
        cos, sin = np.cos(bearing), np.sin(bearing)
        level, up, none = np.cos(elevation), np.sin(elevation), np.zeros(len(measured))
        if len(self.turn):
            bearing = measured[:, 1]
            cos, sin = np.cos(bearing), np.sin(bearing)
        axes = np.empty((len(measured), 3, 3))
        axes[:, :, 0] = np.stack([level * cos, level * sin, up], axis=1)
        axes[:, :, 1] = np.stack([-sin, cos, none], axis=1)
        axes[:, :, 2] = np.stack([-up * cos, -up * sin, level], axis=1)
        sides, slant = std.copy(), np.maximum(measured[:, 0], MIN_RANGE)
        sides[:, 1] *= np.maximum(slant * np.abs(level), MIN_RANGE)
        sides[:, 2] *= slant
        if len(self.turn):
            axes = self._heading @ self.turn.T @ axes
        return PlanePlots(self.to_world(measured), axes, sides)

    @property
    def _heading(self) -> FloatArray:
        """Rotation from the level frame to the world's, (3, 3)."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def places_of_births(self, detections: Detections) -> Births:
        """Return the hypotheses of the places of births: several heights without an elevation.

        Each cell of the heights that the radar can see at the detection's range has a Gaussian. Its
        covariance is tilted along the circle of constant slant range. A reported height has one of
        its own, as far as it is not garbled.
        """
        std = self.noise_std_of(detections)
        unknown = std[:, 2] >= UNKNOWN_STD
        if not unknown.any():
            return super().places_of_births(detections)
        known = np.flatnonzero(~unknown)
        seen = super().places_of_births(detections.take(known))
        own = self.reported_heights
        heights = None if own is None else own.of(detections)
        row, share, places = self._at_heights(np.flatnonzero(unknown), detections, std, heights)
        rows = np.concatenate([known[seen.row], row])
        order = np.argsort(rows, kind="stable")
        columns = (np.concatenate(parts)[order] for parts in zip(seen.plots, places, strict=True))
        shares = np.concatenate([seen.share, share])
        return Births(rows[order], shares[order], PlanePlots(*columns))

    def _at_heights(
        self, rows: IntArray, detections: Detections, std: FloatArray, heights: Heights | None
    ) -> tuple[IntArray, FloatArray, PlanePlots]:
        """Return the hypotheses of `places_of_births` for these rows: row, share and places."""
        if len(self.turn):
            return self._at_elevations(rows, detections, std)
        slant = np.maximum(detections.measurement[rows, 0], MIN_RANGE)
        low, high = (
            self._on_ground(slant, np.full(len(rows), math.sin(edge)))[1]
            for edge in self.visibility.elevation_limits
        )
        share, height, width = self.height_prior.cells(low, high)
        deviations = np.tile(width / math.sqrt(12.0), (len(share), 1))
        if heights is not None:
            own = heights.take(rows)
            # A height that is farther away than the target is garbled.
            near = own.is_known & (np.abs(own.height - self.height) <= slant + 3.0 * own.std)
            true = np.where(near, 1.0 - own.garbled, 0.0)
            share = np.concatenate([share * (1.0 - true), true[None]])
            height = np.concatenate([height, np.where(near, own.height, self.height)[None]])
            deviations = np.concatenate([deviations, own.std[None]])
        count, kept = len(rows), np.flatnonzero(share.ravel())
        row, above = rows[kept % count], height.ravel()[kept] - self.height
        slant, deviation = slant[kept % count], deviations.ravel()[kept]
        # The elevation at which a ray of this length ends at this height.
        sine = (above + 0.5 * self.curvature * (above**2 - slant**2)) / slant
        sine = np.clip(sine, -1.0, 1.0)
        level, _ = self._on_ground(slant, sine)
        level = np.maximum(level, MIN_RANGE)
        bearing = detections.measurement[row, 1] + self.yaw
        cos, sin = np.cos(bearing), np.sin(bearing)
        root = np.zeros((len(row), 3, 3))
        # At a given height the range decides on the distance, and at a given range the height.
        stretch, lean = slant / level * std[row, 0], -above / level * deviation
        root[:, 0, 0], root[:, 1, 0] = stretch * cos, stretch * sin
        sideways = level * std[row, 1]
        root[:, 0, 1], root[:, 1, 1] = -sideways * sin, sideways * cos
        root[:, 0, 2], root[:, 1, 2], root[:, 2, 2] = lean * cos, lean * sin, deviation
        position = np.stack(
            [self.position[0] + level * cos, self.position[1] + level * sin, above + self.height],
            axis=1,
        )
        return row, share.ravel()[kept], PlanePlots(position, root, np.ones((len(row), 3)))

    def _at_elevations(
        self, rows: IntArray, detections: Detections, std: FloatArray
    ) -> tuple[IntArray, FloatArray, PlanePlots]:
        """Return the results of `_at_heights` of a tilted array, in cells of its elevations.

        Reported heights are left to the update.
        """
        prior, (low, high) = self.height_prior, self.visibility.elevation_limits
        cells = prior.CELLS
        centre = low + (high - low) / cells * (np.arange(cells) + 0.5)
        row = rows.repeat(cells)
        measured, own = detections.measurement[row].copy(), std[row].copy()
        measured[:, 2] = np.tile(centre, len(rows))
        own[:, 2] = (high - low) / cells / math.sqrt(12.0)
        plots = self.in_plane(Detections(measured, None, noise_std=own))
        height = plots.position[:, 2]
        share = np.exp(-0.5 * np.square((height - prior.mean) / prior.std))
        # By elevation, and none below the floor.
        share *= np.abs(plots.axes[:, 2, 2]) * (height >= prior.floor)
        share = share.reshape(-1, cells)
        total = share.sum(axis=1, keepdims=True)
        share = np.where(total > 0.0, share / np.where(total > 0.0, total, 1.0), 1.0 / cells)
        (kept,) = np.nonzero(share.ravel())
        columns = (column[kept] for column in plots)
        return row[kept], share.ravel()[kept], PlanePlots(*columns)

    def log_jacobian(self, measured: FloatArray) -> FloatArray:
        """Return log |dz/dp| at measurements; shape (N,)."""
        distance = np.maximum(measured[:, 0], MIN_RANGE)
        level = np.maximum(distance * np.abs(np.cos(measured[:, 2])), MIN_RANGE)
        log_jacobian: FloatArray = -np.log(distance * level)
        return log_jacobian
