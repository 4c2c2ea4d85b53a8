"""Clutter map of a radar: clutter density by cell, learned from unclaimed detections.

Quays, wind turbines and land return echoes from the same place in every revolution. Only cells with
clutter are stored, so that the map of a precise radar with a long range is small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, contains, zeros_field
from ...sensors.polar_radar import polar_radars
from ...sensors.sensor import Sensor
from ...sensors.view import View
from ...snapshot import MAX_STATE, Snapshot, floats, from_snapshot, integers, restored, to_snapshot
from ...targets import stationary
from ..factor import Factor, Look
from . import neighbourhood
from .grid import Grid, GroundGrid, PolarGrid, corners

# Factor of the density at a place with repeated detections away from fixed clutter: the detections
# of one reflector are some three times denser than the cells resolve, and repetition is evidence of
# clutter.
ALONE_FACTOR = 5.0
# The same factor among reflectors, whose detections resemble those of a moving target.
REFLECTOR_FACTOR = 60.0
# Factor of the prior in a neighbourhood: reflectors lie in lines, in a sixth of its cells or less.
GATHERED = 6.0
# Number of detections that a moving target leaves before it has a track; a reflector must have more
# in its cell, and rain in its neighbourhood.
PASSING = 2.0
# Share of revolutions with a detection below which a cell probably contains no reflector.
MIN_SHARE = 0.15
# Weight of the prior density, in revolutions.
PRIOR_REVOLUTIONS = 5.0
# Memory of the map, in revolutions.
MEMORY_REVOLUTIONS = 100.0
# Delay, in revolutions, until a detection counts: a moving target has left the cell by then.
RECENT_REVOLUTIONS = 6.0
# Cells with a smaller count are dropped, and the smallest ones beyond MAX_CELLS.
MIN_COUNT = 1e-3
MAX_CELLS = 1 << 16
# Upper bound of a cell's count accepted in a snapshot: detections of one report add up in one cell.
MAX_IN_CELL = 1e9
# Upper bound of the revolutions accepted in a snapshot: rounding may slightly exceed the memory.
MAX_REVOLUTIONS = 1.001 * MEMORY_REVOLUTIONS


class Place(NamedTuple):
    """The location of a sensor with a learned clutter map."""

    # World x and y in metres, and yaw in radians, (3,).
    pose: Annotated[FloatArray, floats("X", -MAX_STATE, MAX_STATE)]


@dataclass(frozen=True, eq=False)
class ClutterMap(Factor):
    """False detections remembered by cell.

    A cell's clutter is the sum of clutter with a known law over range and of local clutter. A
    detection counts k revolutions later with exp(-k / MEMORY_REVOLUTIONS) - exp(-k /
    RECENT_REVOLUTIONS). With n detections in T revolutions that count, the local rate is::

        (PRIOR_REVOLUTIONS GATHERED A / CELLS + b n^2 / (n + PASSING + MIN_SHARE T)) /
        (PRIOR_REVOLUTIONS + T)

    This is the posterior mean with a Gamma prior, except for the two factors of n: b keeps quays
    from becoming targets, and n / (n + ...) keeps moving ships from being masked by their own first
    detections. The neighbourhood determines the prior: A is its number of detections per revolution
    beyond one reflector and uniform clutter, counted without delay, and b rises with A from
    ALONE_FACTOR to REFLECTOR_FACTOR; see `neighbourhood`. Rain is nowhere long enough for this: the
    local rate is at least B / CELLS times s / (s + PASSING). B is the number of the neighbourhood's
    recent detections per revolution, with the memory RECENT_REVOLUTIONS, beyond uniform clutter.
    The surplus s is the number of recent detections less PASSING, for one new target, and less the
    number that is usual there. This is known from earlier detections: at least that of uniform
    clutter, and at most that of uniform clutter and one reflector.

    The sea and rain that lasts fill an area evenly, and ships cross it. There the local rate is
    A / CELLS: with the probability w of such an area, the geometric mean of both rates with the
    weights 1 - w and w, and A counts only with 1 - w for b.

    Where stationary targets are not clutter, ALONE_FACTOR is multiplied by the share that the
    neighbourhood has of its own and the place's detections beyond uniform clutter. It is large in
    rain, and small for a ship alone at anchor, which would otherwise be clutter for ever if it is
    missed before it has a track.
    """

    NAME: ClassVar[str] = "clutter_map"

    grid: Grid  # A detection counts in the four nearest cells
    # Row times the number of the grid's columns, plus column; ascending, (K,).
    cell: Annotated[IntArray, integers("K", 0, ascending=True)] = zeros_field(0, dtype=np.int64)
    # Remembered detections of each cell, (K,).
    count: Annotated[FloatArray, floats("K", 0.0, MAX_IN_CELL)] = zeros_field(0)
    # Remembered revolutions; a scan of the whole field is one.
    revolutions: Annotated[float, floats("", 0.0, MAX_REVOLUTIONS)] = 0.0
    # Detections of each cell that do not count yet, (K,).
    recent: Annotated[FloatArray, floats("K", 0.0, MAX_IN_CELL)] = zeros_field(0)
    recent_revolutions: Annotated[float, floats("", 0.0, MAX_REVOLUTIONS)] = 0.0  # Not counted yet
    # Detections of targets slower than this are learned as clutter, metres per second.
    speed: float = 0.0

    def expect(self, view: View) -> View:
        """Return the report with the map."""
        return view.changed(local_clutter=(*view.local_clutter, self), fixed_clutter=self)

    def log_factor(self, log_factor: FloatArray, measurement: FloatArray, view: View) -> FloatArray:
        """Return the log ratio of clutter to the uniform one; see `view.LocalClutter`."""
        (radar,) = polar_radars([view.sensor])
        return log_factor + self.log_density(
            measurement,
            radar.to_world(measurement),
            radar.visibility.clutter_of_revolution(view.clutter_rate)
            * view.clutter_ratio(measurement),
            radar.visibility.clutter_range,
            alone=self.speed > 0.0,
        )

    def learn(self, look: Look) -> ClutterMap:
        """Learn from unclaimed detections, and from those of targets at rest if `speed` is set."""
        view, revolutions = look.view, look.view.part_of_revolution
        if not (revolutions and view.complete):
            return self
        claims, targets = look.association.claims, look.targets
        slower = claims.share_of(targets.probability_slower(self.speed))
        resting = targets.at_even_odds(slower, self.speed)
        weight = 1.0 - look.association.claimed_probability * (1.0 - resting)
        measurement = view.detections.measurement
        return self.after(measurement, view.sensor.to_world(measurement), weight, revolutions)

    def continuing(self, earlier: ClutterMap) -> ClutterMap:
        """Return this configured map with the cells of an earlier one, and their counts."""
        return super().continuing(earlier).changed(grid=earlier.grid)

    def to_snapshot(self, snapshot: Snapshot, name: str, sensor: Sensor) -> None:
        """Store the map, its grid and the place of its sensor."""
        super().to_snapshot(snapshot, name, sensor)
        to_snapshot(self.grid, snapshot, f"{name}.grid")
        to_snapshot(_place_of(sensor), snapshot, name)

    def restored(self, snapshot: Snapshot, name: str, sensor: Sensor) -> ClutterMap:
        """Return the stored map; see `Factor.restored`."""
        pose = _place_of(sensor).pose.tolist()
        stored = from_snapshot(Place, snapshot, name, {"X": 3}).pose.tolist()
        if stored != pose:
            raise ValueError(
                f"{name}: map of a radar at {stored} (x, y in m, yaw in rad), expected {pose}"
            )
        polar = isinstance(self.grid, PolarGrid)
        if polar != (f"{name}.grid.columns" in snapshot.arrays):
            stored_kind, sensor_kind = ("moving", "fixed") if polar else ("fixed", "moving")
            raise ValueError(
                f"{name}: map of a {stored_kind} radar given, but this radar is {sensor_kind}"
            )
        grid_type: type[Grid] = PolarGrid if polar else GroundGrid
        grid = from_snapshot(grid_type, snapshot, f"{name}.grid", {})
        learned = restored(self.changed(grid=grid), snapshot, name, self.SIZES)
        if len(learned.cell) > MAX_CELLS:
            raise ValueError(f"{name}.cell: {len(learned.cell)} cells, at most {MAX_CELLS}")
        return learned

    def around(self, view: View, measured: FloatArray, world: FloatArray) -> FloatArray:
        """Return the detections per revolution around places; see `view.FixedClutter`.

        The cells of a moving radar are fixed in the world, in which it has no field of view.
        """
        (radar,) = polar_radars([view.sensor])
        field = radar.visibility
        rate = field.clutter_of_revolution(view.clutter_rate) * view.clutter_ratio(measured)
        excess = self.neighbourhood_excess(measured, world, rate, field.clutter_range)
        if isinstance(self.grid, GroundGrid):
            return excess
        return np.where(field.probability_in_view(measured) > 0.0, excess, np.inf)

    def log_density(
        self,
        measurement: FloatArray,
        world: FloatArray,
        rate: FloatArray | float,
        max_range: float,
        *,
        alone: bool = True,
    ) -> FloatArray:
        """Return the log density of all clutter relative to the uniform one, (M,); at least 0.

        Measurements are range and azimuth, metres and radians, (M, 2); `world` has the same places
        in the world frame, metres. `rate` is the number of expected false detections per
        revolution, above 0, which are uniform in azimuth and in range up to `max_range`, metres;
        (M,) if it is that of the density at each place.
        With `alone` a place with repeated detections is clutter also where there is no other
        clutter.
        """
        cell, share = corners(self.grid, self.grid.places(measurement, world))
        lasting, begun, around, area = self._excesses(measurement, world, rate, max_range)
        cell_count, counted = np.zeros(cell.shape), np.zeros(cell.shape)
        if len(self.cell):
            index = np.minimum(np.searchsorted(self.cell, cell), len(self.cell) - 1)
            known = np.where(self.cell[index] == cell, share, 0.0)
            counted = known * self.count[index]
            cell_count = known * np.maximum(self.count[index] - self.recent[index], 0.0)
        local_count = cell_count.sum(axis=0)
        revolutions = max(self.revolutions - self.recent_revolutions, 0.0)
        among = stationary.among_fixed_clutter((1.0 - area) * lasting)
        alone_factor = np.full(len(measurement), ALONE_FACTOR)
        if not alone:
            own = counted.sum(axis=0) / max(self.revolutions, 1.0)
            alone_factor *= around / np.maximum(around + own, MIN_COUNT)
        factor = alone_factor + (REFLECTOR_FACTOR - alone_factor) * among
        mean = lasting / neighbourhood.CELLS
        local = factor * local_count**2 / (local_count + PASSING + MIN_SHARE * revolutions)
        local += PRIOR_REVOLUTIONS * GATHERED * mean
        # A cell with many more detections than the others of an area is a reflector there.
        surplus = np.maximum(local_count - mean * revolutions - PASSING, 0.0)
        area *= mean * revolutions / np.maximum(mean * revolutions + surplus, MIN_COUNT)
        local = (local / (PRIOR_REVOLUTIONS + revolutions)) ** (1.0 - area) * mean**area
        local = np.maximum(local, begun / neighbourhood.CELLS)
        log_uniform = np.log(rate) + self.grid.log_share(measurement, max_range)
        with np.errstate(divide="ignore"):  # Cells without detections
            log_factor: FloatArray = np.logaddexp(0.0, np.log(local) - log_uniform)
        return log_factor

    def neighbourhood_excess(
        self, measurement: FloatArray, world: FloatArray, rate: FloatArray | float, max_range: float
    ) -> FloatArray:
        """Return the detections per revolution in the neighbourhood of each place, (M,).

        Those of one reflector and of uniform clutter are subtracted. For the arguments see
        `log_density`.
        """
        lasting, _, _, area = self._excesses(measurement, world, rate, max_range)
        return (1.0 - area) * lasting

    def _excesses(
        self, measurement: FloatArray, world: FloatArray, rate: FloatArray | float, max_range: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return numbers of detections per revolution in the neighbourhood of each place, (M,).

        They are those beyond one reflector and uniform clutter, the clutter that has begun, and all
        beyond uniform clutter. The last column is `neighbourhood.probability_of_area`. A surplus of
        recent detections is evidence that they are all clutter.
        """
        count, recent, square = neighbourhood.detections_around(
            self.grid,
            self.cell,
            np.stack([self.count, self.recent, self.count**2]),
            self.grid.places(measurement, world),
        )
        share = neighbourhood.CELLS * np.exp(self.grid.log_share(measurement, max_range))
        uniform = rate * np.minimum(share, 1.0)
        expected = neighbourhood.UNCOUNTED + uniform
        usual = count / max(self.revolutions, 1.0)
        # The recent detections do not explain themselves, only the earlier ones do.
        earlier = np.maximum(count - recent, 0.0) / max(
            self.revolutions - self.recent_revolutions, 1.0
        )
        revolutions = max(self.recent_revolutions, 1.0)
        known = revolutions * np.clip(earlier, uniform, expected)
        surplus = np.maximum(recent - known - PASSING, 0.0)
        begun = surplus / (surplus + PASSING) * np.maximum(recent / revolutions - uniform, 0.0)
        area = neighbourhood.probability_of_area(count, square, usual / neighbourhood.CELLS)
        lasting = usual - np.minimum(usual, expected)
        return lasting, begun, np.maximum(usual - uniform, 0.0), area

    def after(
        self, measurement: FloatArray, world: FloatArray, weight: FloatArray, revolutions: float
    ) -> ClutterMap:
        """Return the map after a further report.

        `weight` has the probability that no target is the source of each detection, (M,), and
        `revolutions` is the part of a revolution that the report covers; for the others see
        `log_density`.
        """
        retention, recent_retention = (
            np.exp(-revolutions / MEMORY_REVOLUTIONS),
            np.exp(-revolutions / RECENT_REVOLUTIONS),
        )
        corner, share = corners(self.grid, self.grid.places(measurement, world))
        new_cell, index = np.unique(corner.ravel(), return_inverse=True)
        added = np.bincount(
            index.ravel(), weights=(share * weight).ravel(), minlength=len(new_cell)
        )
        position = np.searchsorted(self.cell, new_cell)
        is_known = contains(self.cell, new_cell)
        count, recent = retention * self.count, recent_retention * self.recent
        count[position[is_known]] += added[is_known]
        recent[position[is_known]] += added[is_known]
        cell = np.insert(self.cell, position[~is_known], new_cell[~is_known])
        count = np.insert(count, position[~is_known], added[~is_known])
        recent = np.insert(recent, position[~is_known], added[~is_known])
        enough = np.flatnonzero(count >= MIN_COUNT)
        if len(enough) > MAX_CELLS:
            order = np.argsort(-count[enough], kind="stable")[:MAX_CELLS]
            enough = np.sort(enough[order])
        return self.changed(
            cell=cell[enough],
            count=count[enough],
            revolutions=retention * self.revolutions + revolutions,
            recent=recent[enough],
            recent_revolutions=recent_retention * self.recent_revolutions + revolutions,
        )


def _place_of(sensor: Sensor) -> Place:
    return Place(np.array([*sensor.position, sensor.yaw], dtype=np.float64))
