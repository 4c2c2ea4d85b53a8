"""Findings as tracker parameters: proposed value, standard deviation and current value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.radar_input import AUTO
from phd_jdtc_ros.configuration.schema import Value

from .findings import MOST_LAND, Findings

# A configured table of detection probability over range is kept if the estimate lies within its
# values, plus or minus this.
SAME_PROBABILITY = 0.05
# Plausible false alarm probabilities of a receiver; outside them the noise level is unknown.
ALARMS = (1e-12, 0.5)
# A configured maximum range is kept if no plot lies beyond it and it is below this many times the
# range of the farthest plot.
MOST_BEYOND = 1.5
# Clutter counts as noise if its mean level is within this factor of the noise level.
NOISE_FACTOR = 1.25
MOST_PROBABILITY = 0.999


@dataclass(frozen=True)
class Row:
    """A figure estimated from a recording.

    Parameters
    ----------
    name : str
        The parameter, or a description if no parameter follows from the figure.
    std : float
        Standard deviation; NaN if there is none.
    source : str
        The data it was estimated from.
    now : value or str or None
        The current value; None if none is set.
    proposed : bool
        Whether the value is proposed for the parameter.
    """

    name: str
    value: Value
    std: float
    source: str
    now: Any = None
    proposed: bool = True


def rows(found: Findings, values: Mapping[str, Any], radar: str) -> list[Row]:
    """Return the figures of a radar.

    Parameters
    ----------
    values : mapping of dotted name to value
        The current configuration; all parameters.
    radar : str
        Name of the radar.
    """

    def now(name: str) -> Any:
        return values.get(f"{radar}.{name}")

    when, noise = found.timing, found.noise
    tracks = f"{noise.plots} plots, {found.tracks} tracks"
    clouds = f"{found.looks:.0f} {'turns' if when.rotation_s else 'clouds'}"
    entries = []
    if when.rotation_s:
        turns = rounded(when.rotation_s, when.rotation_std_s)
        entries.append(Row("rotation_s", turns, when.rotation_std_s, clouds, now("rotation_s")))
        if not when.timed or now("sectors"):
            entries.append(Row("sectors", when.sectors, math.nan, clouds, now("sectors")))
    elif now("rotation_s"):
        # The rotation is not observable from plots that share one time.
        note = "as configured: not observable from the plots"
        entries.append(
            Row("rotation_s", now("rotation_s"), math.nan, note, now("rotation_s"), False)
        )
    azimuth_deg = math.degrees(noise.azimuth_std)
    for name, value, log_std in zip(
        ("range_std", "azimuth_std_deg"), (noise.range_std, azimuth_deg), noise.log_std, strict=True
    ):
        std = value * float(log_std)
        entries.append(Row(name, rounded(value, std), std, tracks, now(name)))
    by_band = found.levels is not None and values.get("amplitude", "none") != "none"
    entries.append(_detection(found, now, by_band))
    farthest = _up(found.field.max_range)
    seen = f"{found.plots} plots"
    limit = now("max_range")
    far = limit is None or not farthest <= limit <= MOST_BEYOND * farthest
    entries.append(Row("max_range", farthest, math.nan, seen, limit, far))
    rate = found.clutter
    free = f"{rate.count} plots outside tracks"
    # A learned clutter rate stays learned.
    given = now("clutter_rate")
    entries.append(
        Row(
            "clutter_rate",
            rounded(rate.value, rate.std),
            rate.std,
            free,
            given,
            given != AUTO,
        )
    )
    reach = farthest if limit is None or far else limit
    clutter_range = min(rounded(found.field.clutter_range, 0.01 * farthest), reach)
    entries.append(
        Row("clutter_max_range", clutter_range, math.nan, free, now("clutter_max_range"))
    )
    if found.land > MOST_LAND:
        again = f"{100.0 * found.land:.0f} % of plots in recurring places"
        entries.append(Row("clutter_map", True, math.nan, again, now("clutter_map")))
    if found.field.arc is not None:
        entries.append(Row("fov_deg", _fov(found.field.arc, now), math.nan, seen, now("fov_deg")))
    return entries + _amplitudes(found, now) + _motion(found)


def interval_s(found: Mapping[str, Findings]) -> float:
    """Return the nominal interval: the shortest time between two looks of a radar, seconds."""
    shortest = min(each.timing.look_s for each in found.values())
    return rounded(shortest, 1e-3 * shortest)


def _detection(found: Findings, now: Any, by_band: bool) -> Row:
    """Return the detection probability; SNR bands or a configured table that agrees are kept."""
    rate = found.detection
    value = min(rounded(rate.value, 0.01), MOST_PROBABILITY)
    source = f"{rate.count} opportunities"
    table = given = now("detection_probability")
    if isinstance(table, list):
        mean = float(np.mean(table[1::2]))
        least, most = min(table[1::2]), max(table[1::2])
        other = not least - SAME_PROBABILITY <= value <= most + SAME_PROBABILITY
        return Row("detection_probability", value, rate.std, source, f"table, {mean:.3g}", other)
    if by_band:
        return Row("detection_probability", value, rate.std, source, "from SNR bands", False)
    return Row("detection_probability", value, rate.std, source, given)


def _amplitudes(found: Findings, now: Any) -> list[Row]:
    levels = found.levels
    if levels is None:
        return [Row("amplitudes", "none", math.nan, f"{found.plots} plots", None, False)]
    source = f"{levels.clutter} plots outside tracks"
    alarm = levels.false_alarm_probability
    known = ALARMS[0] <= alarm <= ALARMS[1]
    entries = [
        Row(
            "false_alarm_probability",
            rounded(alarm, 0.1 * alarm) if alarm > 0.0 else 0.0,
            math.nan,
            f"{levels.clutter + levels.targets} amplitudes",
            now("false_alarm_probability"),
            known,
        )
    ]
    if levels.clutter and known:
        noise = 1.0 / NOISE_FACTOR <= levels.excess <= NOISE_FACTOR
        law = "rayleigh" if noise else "learned"
        # A configured clutter law stays if the recording shows only noise.
        entries.append(
            Row("clutter_amplitude", law, math.nan, source, now("clutter_amplitude"), not noise)
        )
    low, high = levels.target_db
    if math.isfinite(low):
        band = [round(low, 1), round(high, 1)]
        entries.append(
            Row("tracks' SNR, dB", band, math.nan, f"{found.tracks} tracks", None, False)
        )
    return entries


def _motion(found: Findings) -> list[Row]:
    """Return the targets' speeds and accelerations, which the motion models must cover."""
    calm, hard = (rounded(density, 0.1 * density) for density in found.noise.densities)
    source = f"{found.noise.plots} plots, {found.tracks} tracks"
    return [
        Row(
            "speeds, m/s",
            rounded(found.speed_std * math.sqrt(2.0), 0.1),
            math.nan,
            source,
            None,
            False,
        ),
        Row("accelerations, m^2/s^3", [calm, hard], math.nan, source, None, False),
    ]


def _fov(arc: tuple[float, float], now: Any) -> list[float]:
    """Return the field of view in the radar's convention, widened by two degrees on each side."""
    begin, width = math.degrees(arc[0]) - 2.0, min(math.degrees(arc[1]) + 4.0, 360.0)
    if now("azimuth_convention") == "compass_cw":
        begin = 90.0 - begin - width
    begin = round((begin + 180.0) % 360.0 - 180.0, 1)
    return [begin, round(begin + width, 1)]


def rounded(value: float, std: float) -> float:
    """Return a value rounded to a twentieth of its standard deviation, and to five digits."""
    if not (math.isfinite(value) and value):
        return 0.0
    digits = 5
    if std > 0.0:
        digits = min(max(math.ceil(math.log10(abs(value) / std) + 1.3), 2), 5)
    return float(f"{value:.{digits}g}")


def _up(value: float) -> float:
    """Return a value rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.6g}")
