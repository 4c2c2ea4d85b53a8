"""Where a scan's detections are in the world, and what they tell of velocities there.

The proposals of `proposal`, `range_rate_proposal` and `detected_newborns` draw near them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ...arrays import FloatArray, IntArray
from ...models.tracker_model import TrackerModel
from ...sensors.report import Report
from ...types import Scan


@dataclass(frozen=True)
class PlaceRates:
    """The range rates of detections, each with the radar that measured it.

    Parameters
    ----------
    rate : array of shape (M,)
        Metres per second relative to the radar; NaN where it is unknown.
    std : array of shape (M,)
        Metres per second.
    ambiguity : array of shape (M,)
        The interval modulo which it is known, metres per second; infinite if it is known wholly.
    radar_position, radar_velocity : arrays of shape (M, 2)
        In the world frame, metres and metres per second.
    """

    rate: FloatArray
    std: FloatArray
    ambiguity: FloatArray
    radar_position: FloatArray
    radar_velocity: FloatArray

    def take(self, rows: IntArray) -> PlaceRates:
        """Return those of these rows."""
        return PlaceRates(*(getattr(self, part.name)[rows] for part in fields(self)))


@dataclass(frozen=True)
class Places:
    """The detections of a scan in the world.

    Parameters
    ----------
    position : array of shape (M, 2)
        At the time of the detection, metres.
    covariance : array of shape (M, 2, 2)
        Square metres.
    time_s : array of shape (M,)
        Relative to the scan's stamp, seconds.
    rates : PlaceRates or None
        None if none of them has a range rate that is to be used.
    """

    position: FloatArray
    covariance: FloatArray
    time_s: FloatArray
    rates: PlaceRates | None = None

    def __len__(self) -> int:
        return len(self.position)

    def take(self, rows: IntArray) -> Places:
        """Return those of these rows."""
        rates = None if self.rates is None else self.rates.take(rows)
        return Places(self.position[rows], self.covariance[rows], self.time_s[rows], rates)

    def sharper_than(self, std: float) -> Places:
        """Return the detections whose larger deviation is below `std`, metres."""
        return self.take(np.flatnonzero(np.linalg.eigvalsh(self.covariance)[:, 1] < std**2))


def places(scan: Scan, model: TrackerModel) -> Places:
    """Return where a scan's detections are, of all radars."""
    reports = model.reports(scan)
    found = [places_of(report) for report in reports]
    return Places(
        np.concatenate([np.zeros((0, 2)), *(part.position for part in found)]),
        np.concatenate([np.zeros((0, 2, 2)), *(part.covariance for part in found)]),
        np.concatenate([np.zeros(0), *(part.time_s for part in found)]),
        _rates(reports),
    )


def _rates(reports: Sequence[Report]) -> PlaceRates | None:
    """Return the range rates of all detections; None if there are none to be used."""
    measured = [report.range_rates for report in reports]
    if all(found is None or np.isnan(found.rate).all() for found in measured):
        return None
    columns: list[tuple[FloatArray, ...]] = []
    for report, found in zip(reports, measured, strict=True):
        every, radar = np.ones(len(report)), report.sensor
        told = (np.nan * every, every, np.inf * every)
        if found is not None:
            told = (found.rate, found.std, (found.model.ambiguity or np.inf) * every)
        columns.append((*told, np.outer(every, radar.position), np.outer(every, radar.velocity)))
    return PlaceRates(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def places_of(report: Report) -> Places:
    """Return where one report's detections are, without their range rates."""
    return Places(report.in_plane.position, report.in_plane.covariance, report.time_s)
