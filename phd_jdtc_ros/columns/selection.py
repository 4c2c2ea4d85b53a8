"""Selects the valid detections among a message's points, in the core's units."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.bias import NO_BIAS
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities, sent_columns

# No azimuth, in radians or degrees, has a larger magnitude; a range has.
NO_ANGLE = 720.0
# Largest time from the stamp if the time of a revolution is unknown, seconds.
MAX_SECONDS_OFF = 60.0
# Plausible standard deviations of ranges, m.
RANGE_STDS = (1e-3, 1e5)
# Upper bound of range rates, m/s; targets of such a radar are slower.
MAX_RANGE_RATE = 5e3
# Plausible standard deviations of range rates, m/s.
RANGE_RATE_STDS = (1e-3, 1e3)

# A message's columns by quantity, as the radar reports them, arrays of shape (M,); see `Fields`.
Columns: TypeAlias = Mapping[str, FloatArray]


# The reason of points that are no detections: those without any place, as NaN, zeros or another
# number in both coordinates say, fill a cloud of a fixed size, or stand for a scan without any.
PADDING = "padding"


@dataclass(frozen=True)
class Report:
    """A decoded message."""

    stamp_ns: int  # Stamp without the radar's time offset
    detections: Detections  # `amplitude` is None if the message has no amplitudes
    # Points left out, by reason: `PADDING`, ``not_finite``, ``height``, ``range``, ``azimuth``,
    # ``time``, ``amplitude``.
    dropped: Counter[str]
    # Points, or messages, that are used but contradict their configuration; see `anomalies`.
    anomalies: Counter[str] = field(default_factory=Counter)
    sector: int | None = None  # Number of the sector; None if unknown


def select(stamp_ns: int, radar: RadarParameters, columns: Columns) -> Report:
    """Return the valid detections of a message in the core's units, and count the other points.

    NaN marks an unknown amplitude, height, range rate or standard deviation; its point is kept. A
    point with an impossible range rate, code, address or detection type is kept too, and that value
    is unknown.

    The radar's systematic errors are removed first; a range that becomes negative is set to 0.
    """
    # Largest azimuth within a revolution: compass azimuths may be rounded up beyond a whole
    # revolution.
    largest_azimuth = FULL_TURN * (1.0 + 1e-6)
    distance, height = columns["range"], columns.get("height")
    if radar.bias != NO_BIAS:
        true = np.maximum(radar.bias.true_range(distance), 0.0)
        distance = np.where(distance < 0.0, distance, true)
    azimuth = np.radians(columns["azimuth"]) if radar.units.in_degrees else columns["azimuth"]
    azimuth_size = np.abs(azimuth)
    if radar.units.compass:
        azimuth = np.pi / 2.0 - azimuth
    if radar.bias.azimuth:
        azimuth = azimuth - radar.bias.azimuth
    elevation, unknown, sine = columns.get("elevation"), 0, None
    zero, unit = radar.units.elevation_scale
    if elevation is not None and unit != 1.0:
        elevation = zero + unit * elevation
    counts = {} if elevation is None else _strange_elevations(distance, elevation, radar)
    if radar.height_prior is None:
        ground = ground_ranges.read(distance, azimuth, elevation, height, radar)
        reach, possible, sine = ground.distance, ground.possible, ground.sine
        measurement = np.stack([ground.distance, ground.azimuth], axis=1)
    else:
        elevation, unknown = _measured_elevation(elevation)
        measurement = ground_ranges.in_space(distance, azimuth, elevation, radar)
        reach, possible = distance, np.ones(len(distance), dtype=bool)
    # Nothing is at a range of exactly 0, and -999 or 9999 in both stand for what is unknown.
    one_number = (columns["range"] == columns["azimuth"]) & (
        (columns["range"] <= 0.0) | (np.abs(columns["azimuth"]) > NO_ANGLE)
    )
    is_place = ~(np.isnan(columns["range"]) & np.isnan(columns["azimuth"]) | one_number)
    passed = {
        PADDING: is_place,
        "not_finite": _finite(columns, in_space=radar.height_prior is not None),
        "height": possible,
        # An elevation beyond the zenith is invalid, and makes the ground range negative.
        "range": (distance >= 0.0) & (reach >= radar.min_range) & (reach <= radar.max_range),
        # Largest azimuth in revolutions; beyond it, single precision is coarser than 0.03 degrees.
        "azimuth": azimuth_size <= 1000.0 * FULL_TURN,
    }
    most_s = 1.5 * radar.rotation_s if radar.rotation_s else MAX_SECONDS_OFF
    kept, dropped, common, common_counts = keep(stamp_ns, radar, columns, passed, most_s)

    range_std, bad_ranges = kept_values(columns, "range_std", kept, RANGE_STDS)
    scale = np.pi / 180.0 if radar.units.in_degrees else 1.0
    # Plausible standard deviations of azimuths, rad.
    azimuth_std, bad_azimuths = kept_values(columns, "azimuth_std", kept, (1e-6, np.pi), scale)
    rate_std, bad_rate_stds = kept_values(columns, "range_rate_std", kept, RANGE_RATE_STDS)
    rate, bad_rates = kept_values(columns, "range_rate", kept, (-MAX_RANGE_RATE, MAX_RANGE_RATE))
    interval = radar.range_rate_ambiguity or np.inf
    sector, bad_sectors = _sector(columns.get("sector"), radar)
    measurement = measurement[kept]
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    if radar.height_prior is not None:
        # Plausible standard deviations of elevations, rad.
        own_std, bad = kept_values(columns, "elevation_std", kept, (1e-6, 0.5 * np.pi), abs(unit))
        noise_std = _spatial_noise(measurement, range_std, azimuth_std, own_std)
        bad_azimuths += bad
    rise = None if rate is None or sine is None else np.clip(sine[kept], -1.0, 1.0)
    above, absurd = None if height is None else height[kept] - radar.datum, 0
    if above is not None and radar.height_prior is not None:
        above, absurd = plausible_heights(above)
    detections = Detections(
        measurement,
        **common,
        noise_std=(_noise_std(range_std, azimuth_std) if radar.height_prior is None else noise_std),
        range_rate=rate,
        range_rate_std=None if rate is None else rate_std,
        level=None if rise is None else np.sqrt(1.0 - rise**2),
        rise=rise,
        height=above if radar.height_prior is None else None,
        z=None if radar.height_prior is None else above,
    )
    beyond = is_place & (azimuth_size > largest_azimuth)
    if dropped or beyond.any():
        counts |= _strange_places(columns, is_place, beyond, kept)
    counts |= {
        **common_counts,
        "heights_unknown": 0 if above is None else _count(~np.isfinite(above)) - absurd,
        "heights_unusable": absurd,
        "deviations_unusable": bad_ranges + bad_azimuths + bad_rate_stds,
        "elevations_unknown": unknown,
        "sectors_unusable": bad_sectors,
        "range_rates_unusable": bad_rates,
        "range_rates_beyond_ambiguity": (
            # Factor on the ambiguity interval, because single precision may round a range rate
            # beyond it.
            0 if rate is None else _count(np.abs(rate) > (1.0 + 1e-6) * interval)
        ),
    }
    anomalies = Counter({what: count for what, count in counts.items() if count})
    return Report(stamp_ns - radar.bias.offset_ns, detections, dropped, anomalies, sector)


def _strange_places(
    columns: Columns, is_place: BoolArray, beyond: BoolArray, kept: BoolArray
) -> dict[str, int]:
    """Return the numbers of ranges and azimuths that have another meaning, by the likely one.

    The fields are swapped only if all ranges could be azimuths, and not all azimuths.
    """
    distance, azimuth = columns["range"], columns["azimuth"]
    negative = is_place & (distance < 0.0)
    size = np.where(beyond & np.isfinite(azimuth), np.abs(azimuth), 0.0)
    no_angle = size > NO_ANGLE
    # A turn has 360 degrees, 400 gradians or 6400 mils, and often 4096 counts of an encoder.
    gradians = (size > 360.0 * (1.0 + 1e-6)) & (size <= 400.0)
    mils = (size > 4096.0) & (size <= 6400.0)
    may_be_angles = (np.abs(distance[is_place & np.isfinite(distance)]) <= NO_ANGLE).all()
    if may_be_angles and beyond.any() and (negative | no_angle).any():
        return {"fields_swapped": _count(negative | no_angle)}
    return {
        "azimuths_beyond_a_turn": 0 if no_angle.any() else _count(beyond & kept & ~gradians),
        "azimuths_in_gradians": 0 if no_angle.any() else _count(kept & gradians),
        "azimuths_in_mils": _count(mils),
        "azimuths_no_angles": _count(no_angle & ~mils),
        "ranges_negative": _count(negative),
    }


def _count(which: BoolArray) -> int:
    return int(np.count_nonzero(which))


def repeats_of(columns: Columns) -> BoolArray | None:
    """Return which points repeat an earlier point in all columns, bit for bit.

    The result is None if no two values of the first column, range or x, are equal.

    A driver that sends its buffer twice would otherwise make each target appear as a group in
    formation: three copies of each detection made four targets out of one. Noise in double or
    single precision does not repeat, so no other points are removed if amplitudes or times are
    reported. With only a coarse range and azimuth, detections coincide by chance: of 50 per
    revolution within 20 km, 1.6 in 10,000 in cells of 50 m by 1 degree, and 1.1 in 1000 in cells of
    250 m by 1.4 degrees (uniform, 20,000 revolutions). The detection probability falls by that
    share, which costs less than the copies do.
    """
    # Different values, the common case, exclude repetitions at the lowest cost.
    ordered = next(iter(columns.values())).copy()
    ordered.sort()
    if (ordered[1:] != ordered[:-1]).all():
        return None
    repeats = np.ones(len(ordered), dtype=bool)
    # Comparing bits makes unknown amplitudes (NaN) equal.
    numbers = [column.astype(np.float64) for column in columns.values()]
    rows = np.column_stack(numbers).view(np.int64)
    repeats[np.unique(rows, axis=0, return_index=True)[1]] = False
    return repeats


def _finite(columns: Columns, in_space: bool) -> BoolArray:
    """Return which points have finite coordinates and a finite or unknown amplitude.

    In space an elevation may be unknown too.
    """
    finite: BoolArray = np.isfinite(columns["range"]) & np.isfinite(columns["azimuth"])
    if "elevation" in columns and not in_space:
        finite &= np.isfinite(columns["elevation"])
    if "amplitude" in columns:
        # A level of -inf dB would become a valid envelope of zero.
        finite &= columns["amplitude"] != -np.inf
    return finite


def kept_values(
    columns: Columns,
    quantity: str,
    kept: BoolArray,
    bounds: tuple[float, float],
    scale: float = 1.0,
) -> tuple[FloatArray | None, int]:
    """Return a quantity of the kept points, NaN if unknown, and the number beyond the bounds.

    The quantity is None if the message does not have it.
    """
    if quantity not in columns:
        return None, 0
    own = columns[quantity][kept] * scale
    usable = (own >= bounds[0]) & (own <= bounds[1])  # False for NaN
    return np.where(usable, own, np.nan), _count(~usable & ~np.isnan(own))


def _noise_std(range_std: FloatArray | None, azimuth_std: FloatArray | None) -> FloatArray | None:
    """Return both standard deviations of each point, (M, 2); None if all are unknown."""
    known = range_std if azimuth_std is None else azimuth_std
    if known is None:
        return None
    unknown = np.full(len(known), np.nan)
    sides = [unknown if side is None else side for side in (range_std, azimuth_std)]
    noise_std: FloatArray = np.stack(sides, axis=1)
    return noise_std if np.isfinite(noise_std).any() else None


def plausible_heights(height: FloatArray) -> tuple[FloatArray, int]:
    """Return heights, (M,), of which those are unknown that no target has, and their number."""
    # No target is higher, m.
    usable = np.abs(height) <= 1e6
    return np.where(usable, height, np.nan), _count(~usable & ~np.isnan(height))


def _strange_elevations(
    distance: FloatArray, elevation: FloatArray, radar: RadarParameters
) -> dict[str, int]:
    """Return the numbers of elevations beyond the zenith, and of those with the wrong sign.

    The latter are outside the field of view or below the floor, and their opposites are not.
    """
    # Elevations this far outside the field of view are not those of its edge, rad.
    elevation_margin = 0.05
    low, high = np.radians(radar.fov_elevation_deg)
    outside = (elevation < low - elevation_margin) | (elevation > high + elevation_margin)
    if radar.height_prior is not None:
        sine = (radar.height_prior.floor - radar.height) / np.maximum(distance, 1.0)
        outside |= elevation < np.arcsin(np.clip(sine, -1.0, 1.0)) - elevation_margin
    return {
        "elevations_unusable": _count(np.abs(elevation) > 0.5 * np.pi),
        "elevations_opposite": _count(outside & (-elevation >= low) & (-elevation <= high)),
    }


def _measured_elevation(elevation: FloatArray | None) -> tuple[FloatArray | None, int]:
    """Return elevations, None if none of a message is measured, and the number of unknown ones.

    Measured elevations have noise, so that those of a whole message are not all exactly 0: a driver
    fills the field with zeros.
    """
    if elevation is None:
        return None, 0
    unknown = np.isnan(elevation)
    if (unknown | (elevation == 0.0)).all():
        return None, len(elevation)
    return elevation, _count(unknown)


def _spatial_noise(
    measurement: FloatArray,
    range_std: FloatArray | None,
    azimuth_std: FloatArray | None,
    elevation_std: FloatArray | None,
) -> FloatArray | None:
    """Return the standard deviations of each point in space, (M, 3); None if all are unknown.

    An unknown or impossible elevation becomes 0 in `measurement`, with `UNKNOWN_STD`.
    """
    sides = [range_std, azimuth_std, elevation_std]
    unknown = ~(np.abs(measurement[:, 2]) <= 0.5 * np.pi)
    measurement[unknown, 2] = 0.0
    if not unknown.any() and all(side is None for side in sides):
        return None
    nothing = np.full(len(measurement), np.nan)
    noise_std: FloatArray = np.stack([nothing if side is None else side for side in sides], axis=1)
    noise_std[unknown, 2] = UNKNOWN_STD
    return noise_std


def _sector(column: FloatArray | None, radar: RadarParameters) -> tuple[int | None, int]:
    """Return the number of the sector, None if unknown, and 1 if it is invalid, else 0."""
    if column is None or not len(column):
        return None, 0
    number = float(column[0])
    if (column >= identities.NONE).all():
        return None, 0
    if (column != number).any() or not number.is_integer() or not 0 <= number < radar.sectors:
        return None, 1
    return int(number), 0


@cache
def _has_another_unit(name: str) -> bool:
    """Return whether the name of a column of lengths has a unit that is not the metre."""
    units = r"km|nmi?|ft|feet|foot|miles?|kilomet\w+|nautical\w*"
    return bool(re.search(rf"(?i)(?:^|[\W_])(?:{units})(?:$|[\W_])", name))


class Kept(NamedTuple):
    """The points of a message that are used, and what all kinds of sensors report of them."""

    points: BoolArray  # True for the points that are used, (M,)
    dropped: Counter[str]  # Numbers of the others by the test that each fails first
    common: dict[str, Any]  # Fields of `Detections`
    counts: dict[str, int]  # Anomalies


def keep(
    stamp_ns: int,
    sensor: RadarParameters | PositionParameters,
    columns: Columns,
    passed: dict[str, BoolArray],
    most_s: float,
) -> Kept:
    """Return the points that pass the tests, and a time within `most_s` of the stamp, only once.

    `passed` has a truth value per point, (M,), for each test.
    """
    amplitude = time = None
    if "time" in columns:
        time = sent_columns.relative_time(columns["time"], stamp_ns, sensor)
        passed["time"] = np.abs(time) <= most_s  # False for NaN
    if "amplitude" in columns:
        amplitude = linear_amplitude(columns["amplitude"], sensor)
        # Largest envelope: 120 dB above the noise, more than any receiver reports.
        possible = (amplitude >= 0.0) & (amplitude <= 1e6)
        passed["amplitude"] = possible | np.isnan(amplitude)
    kept, dropped = _kept_and_dropped(passed)
    repeated = 0
    if (repeats := repeats_of(columns)) is not None:
        repeated = _count(kept & repeats)
        kept &= ~repeats
    found, impossible = identities.read(columns, kept)
    common = {
        "amplitude": None if amplitude is None else amplitude[kept],
        "time_s": None if time is None else time[kept],
        **found,
    }
    length = getattr(sensor.fields, "range", "") or getattr(sensor.fields, "x", "")
    counts = {
        "lengths_not_in_metres": int(_has_another_unit(length)),
        "detections_repeated": repeated,
        "identities_unusable": impossible,
    }
    return Kept(kept, dropped, common, counts)


def _kept_and_dropped(passed: Mapping[str, BoolArray]) -> tuple[BoolArray, Counter[str]]:
    """Return which points pass every test, and the number of points that each test fails first."""
    tests = np.array([*passed.values()])
    kept: BoolArray = np.logical_and.reduce(tests)
    if kept.all():
        return kept, Counter()
    failed = np.bincount(tests.argmin(axis=0)[~kept], minlength=len(passed)).tolist()
    return kept, Counter({what: count for what, count in zip(passed, failed, strict=True) if count})


def linear_amplitude(raw: FloatArray, sensor: RadarParameters | PositionParameters) -> FloatArray:
    """Convert amplitudes to envelopes in units of the noise's standard deviation per quadrature.

    An envelope a has the SNR a^2 / 2.
    """
    with np.errstate(over="ignore"):  # An absurd level becomes infinite and is then dropped
        if sensor.units.in_db:
            from_db: FloatArray = np.sqrt(2.0 * 10.0 ** ((raw + sensor.amplitude_offset_db) / 10.0))
            return from_db
        scaled: FloatArray = raw * 10.0 ** (sensor.amplitude_offset_db / 20.0)
        return scaled
