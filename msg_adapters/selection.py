"""Selects the valid detections among a message's points, in the core's units."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, wrap_angle
from phd_jdtc_ros.core.sensors.bias import NO_BIAS
from phd_jdtc_ros.core.types import FULL_TURN, Detections

from . import ground_ranges, identities, plot_times

# Largest envelope: 120 dB above the noise, more than any receiver reports.
MAX_AMPLITUDE = 1e6
# Largest azimuth within a turn: compass azimuths may be rounded up beyond a whole turn.
A_TURN = FULL_TURN * (1.0 + 1e-6)
# Largest azimuth in turns; beyond it, single precision is coarser than 0.03 degrees.
MAX_TURNS = 1000.0
# Largest time from the stamp in turns, or in seconds if the time of a turn is unknown.
MAX_TURNS_OFF = 1.5
MAX_SECONDS_OFF = 60.0
# Plausible standard deviations of ranges, m, and of azimuths, rad.
RANGE_STDS = (1e-3, 1e5)
AZIMUTH_STDS = (1e-6, np.pi)
# Upper bound of range rates, m/s; targets of such a radar are slower.
MAX_RANGE_RATE = 5e3
# Tolerance of a range rate at the limit of the ambiguity, for single precision.
AN_INTERVAL = 1.0 + 1e-6
# Plausible standard deviations of range rates, m/s.
RANGE_RATE_STDS = (1e-3, 1e3)


@dataclass(frozen=True)
class Report:
    """A decoded message."""

    stamp_ns: int  # Stamp without the radar's time offset
    detections: Detections  # `amplitude` is None if the message has no amplitudes
    # Points left out, by reason: ``not_finite``, ``height``, ``range``, ``azimuth``, ``time``,
    # ``amplitude``.
    dropped: Counter[str]
    # Points, or messages, that are used but contradict their configuration; see `anomalies`.
    anomalies: Counter[str] = field(default_factory=Counter)
    sector: int | None = None  # Number of the sector; None if unknown


@dataclass(frozen=True)
class Columns:
    """A message's columns as the radar reports them, arrays of shape (M,)."""

    distance: FloatArray  # Metres; slant ranges if there are elevations or heights
    azimuth: FloatArray
    elevation: FloatArray | None = None  # Radians above the sensor's plane
    level: FloatArray | None = None  # Amplitudes
    time: FloatArray | None = None
    height: FloatArray | None = None  # Metres; above the world's zero plus the radar's datum
    # `code`, `address`: mode A codes and Mode S addresses.
    code: FloatArray | None = None
    address: FloatArray | None = None
    kind: FloatArray | None = None  # See `Detections`
    # `range_std`, `azimuth_std`: metres, and in the unit of the azimuth.
    range_std: FloatArray | None = None
    azimuth_std: FloatArray | None = None
    sector: FloatArray | None = None
    # `range_rate`, `range_rate_std`: metres per second, positive for a receding target.
    range_rate: FloatArray | None = None
    range_rate_std: FloatArray | None = None


def select(stamp_ns: int, radar: RadarParameters, columns: Columns) -> Report:
    """Return the valid detections of a message in the core's units, and count the other points.

    Parameters
    ----------
    radar : RadarParameters
        Units, conventions and the maximum range.

    Notes
    -----
    NaN marks an unknown amplitude, height, range rate or standard deviation; its point is kept. A
    point with an impossible range rate, code, address or kind is kept too, and that value is
    unknown.

    The radar's systematic errors are removed first; a range that becomes negative is set to 0.
    """
    if radar.bias != NO_BIAS:
        true = np.maximum(radar.bias.true_range(columns.distance), 0.0)
        columns = replace(
            columns, distance=np.where(columns.distance < 0.0, columns.distance, true)
        )
    azimuth = np.radians(columns.azimuth) if radar.azimuth_in_degrees else columns.azimuth
    turns = np.abs(azimuth)
    if radar.compass:
        azimuth = np.pi / 2.0 - azimuth
    if radar.bias.azimuth:
        azimuth = azimuth - radar.bias.azimuth
    level, time = columns.level, None
    if columns.time is not None:
        time = plot_times.relative(columns.time, stamp_ns, radar)
    amplitude = None if level is None else _linear_amplitude(level, radar)
    finite = _finite(columns, azimuth)
    ground = ground_ranges.read(columns.distance, azimuth, columns.elevation, columns.height, radar)
    kept, dropped = _sorted_out(
        {
            "not_finite": finite,
            "height": ground.possible,
            # An elevation beyond the zenith is invalid, and makes the ground range negative.
            "range": (columns.distance >= 0.0)
            & (ground.distance >= 0.0)
            & (ground.distance <= radar.max_range),
            "azimuth": turns <= MAX_TURNS * FULL_TURN,
            "time": _within_a_turn(time, len(azimuth), radar),
            "amplitude": _possible(amplitude, len(azimuth)),
        }
    )
    repeats = kept & _repeats(columns)
    repeated, kept = int(np.count_nonzero(repeats)), kept & ~repeats
    noise_std, unusable = _noise_std(columns, kept, radar)
    sector, confused = _sector(columns.sector, radar)
    range_rate, rate_anomalies = _range_rate(columns.range_rate, kept, radar)
    code, unusable_codes = identities.read(columns.code, kept, identities.CODES)
    address, unusable_addresses = identities.read(columns.address, kept, identities.ADDRESSES)
    range_rate_std, unusable_rates = _range_rate_std(columns.range_rate_std, kept)
    detections = Detections(
        np.stack([ground.distance[kept], wrap_angle(ground.azimuth[kept])], axis=1),
        None if amplitude is None else amplitude[kept],
        None if time is None else time[kept],
        noise_std,
        range_rate=range_rate,
        range_rate_std=None if range_rate is None else range_rate_std,
        height=None if columns.height is None else columns.height[kept] - radar.datum,
        code=code,
        address=address,
        kind=identities.read(columns.kind, kept, identities.KINDS)[0],
    )
    beyond = 0 if radar.azimuth_in_degrees else np.count_nonzero(turns[kept] > A_TURN)
    unknown = 0 if columns.height is None else np.count_nonzero(~np.isfinite(columns.height[kept]))
    anomalies = Counter(
        detections_repeated=repeated,
        azimuths_beyond_a_turn=int(beyond),
        heights_unknown=int(unknown),
        deviations_unusable=unusable + unusable_rates,
        sectors_unusable=confused,
        identities_unusable=unusable_codes + unusable_addresses,
        **rate_anomalies,
    )
    return Report(stamp_ns - radar.bias.offset_ns, detections, dropped, +anomalies, sector)


def _repeats(columns: Columns) -> BoolArray:
    """Return which points repeat an earlier point in all columns, bit for bit.

    A driver that sends its buffer twice would otherwise make each target appear as a group in
    formation: three copies of each detection made four targets out of one. Noise in double or
    single precision does not repeat, so no other points are removed if amplitudes or times are
    reported. With only a coarse range and azimuth, detections coincide by chance: of 50 per turn
    within 20 km, 1.6 in 10,000 in cells of 50 m by 1 degree, and 1.1 in 1000 in cells of 250 m by
    1.4 degrees (uniform, 20,000 turns). The detection probability falls by that share, which costs
    less than the copies do.
    """
    every_column = (getattr(columns, each.name) for each in fields(columns))
    present = [column.astype(np.float64) for column in every_column if column is not None]
    repeats = np.ones(len(columns.distance), dtype=bool)
    # Unique ranges, the common case, exclude repetitions at the lowest cost.
    if len(np.unique(columns.distance)) == len(repeats):
        return ~repeats
    # Comparing bits makes unknown amplitudes (NaN) equal.
    rows = np.column_stack(present).view(np.int64)
    repeats[np.unique(rows, axis=0, return_index=True)[1]] = False
    return repeats


def _finite(columns: Columns, azimuth: FloatArray) -> BoolArray:
    """Return which points have finite coordinates and a finite or unknown level."""
    finite = np.isfinite(columns.distance) & np.isfinite(azimuth)
    if columns.elevation is not None:
        finite &= np.isfinite(columns.elevation)
    if columns.level is not None:
        # A level of -inf dB would become a valid envelope of zero.
        finite &= columns.level != -np.inf
    return finite


def _within_a_turn(time: FloatArray | None, count: int, radar: RadarParameters) -> BoolArray:
    """Return which times, seconds, are as near to the stamp as a turn allows."""
    if time is None:
        return np.ones(count, dtype=bool)
    most = MAX_TURNS_OFF * radar.rotation_s if radar.rotation_s else MAX_SECONDS_OFF
    near: BoolArray = np.abs(time) <= most  # False for NaN
    return near


def _possible(amplitude: FloatArray | None, count: int) -> BoolArray:
    """Return which envelopes are plausible or unknown."""
    if amplitude is None:
        return np.ones(count, dtype=bool)
    possible: BoolArray = (amplitude >= 0.0) & (amplitude <= MAX_AMPLITUDE)
    return possible | np.isnan(amplitude)


def _noise_std(
    columns: Columns, kept: BoolArray, radar: RadarParameters
) -> tuple[FloatArray | None, int]:
    """Return the own standard deviations, (M, 2), NaN if unknown, and the unusable count.

    The deviations are None if no detection has any.
    """
    scale = np.pi / 180.0 if radar.azimuth_in_degrees else 1.0
    found = np.full((np.count_nonzero(kept), 2), np.nan)
    if columns.range_std is not None:
        found[:, 0] = columns.range_std[kept]
    if columns.azimuth_std is not None:
        found[:, 1] = columns.azimuth_std[kept] * scale
    least, most = np.transpose([RANGE_STDS, AZIMUTH_STDS])
    usable = (found >= least) & (found <= most)
    unusable = int(np.count_nonzero(~usable & ~np.isnan(found)))
    return (np.where(usable, found, np.nan) if usable.any() else None), unusable


def _range_rate(
    column: FloatArray | None, kept: BoolArray, radar: RadarParameters
) -> tuple[FloatArray | None, dict[str, int]]:
    """Return the range rates, NaN if unknown, and the numbers of doubtful ones."""
    if column is None:
        return None, {}
    rate, interval = column[kept], radar.range_rate_ambiguity
    possible = np.abs(rate) <= MAX_RANGE_RATE  # False for NaN
    beyond = possible & (np.abs(rate) > AN_INTERVAL * interval) if interval else ~possible & False
    counts = {
        "range_rates_unusable": int(np.count_nonzero(~possible & ~np.isnan(rate))),
        "range_rates_beyond_ambiguity": int(np.count_nonzero(beyond)),
    }
    return np.where(possible, rate, np.nan), counts


def _range_rate_std(column: FloatArray | None, kept: BoolArray) -> tuple[FloatArray | None, int]:
    """Return the range rates' own standard deviations, NaN if unknown, and the unusable count."""
    if column is None:
        return None, 0
    own = column[kept]
    usable = (own >= RANGE_RATE_STDS[0]) & (own <= RANGE_RATE_STDS[1])
    return np.where(usable, own, np.nan), int(np.count_nonzero(~usable & ~np.isnan(own)))


def _sector(column: FloatArray | None, radar: RadarParameters) -> tuple[int | None, int]:
    """Return the number of the sector, None if unknown, and 1 if it is invalid, else 0."""
    if column is None or not len(column):
        return None, 0
    number = float(column[0])
    if (column != number).any() or not number.is_integer() or not 0 <= number < radar.sectors:
        return None, 1
    return int(number), 0


def _sorted_out(passed: Mapping[str, BoolArray]) -> tuple[BoolArray, Counter[str]]:
    """Return which points pass every test, and the number of points that each test fails first."""
    dropped: Counter[str] = Counter()
    kept = np.ones(len(next(iter(passed.values()))), dtype=bool)
    for reason, passes in passed.items():
        dropped[reason] = int(np.count_nonzero(kept & ~passes))
        kept = kept & passes
    return kept, +dropped


def _linear_amplitude(raw: FloatArray, radar: RadarParameters) -> FloatArray:
    """Convert amplitudes to envelopes in units of the noise's standard deviation per quadrature.

    An envelope a has the SNR a^2 / 2.
    """
    with np.errstate(over="ignore"):  # an absurd level becomes infinite and is then dropped
        if radar.amplitude_in_db:
            from_db: FloatArray = np.sqrt(2.0 * 10.0 ** ((raw + radar.amplitude_offset_db) / 10.0))
            return from_db
        scaled: FloatArray = raw * 10.0 ** (radar.amplitude_offset_db / 20.0)
        return scaled
