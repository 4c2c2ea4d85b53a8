"""Findings as tracker parameters: proposed value, standard deviation and current value."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import Value
from phd_jdtc_ros.core.sensors.site import LEAST_STD

from .area import covers
from .findings import MOST_BESIDE, MOST_CROWDED, Findings, TuningError
from .noise import Noise
from .rounding import round_to_std, round_up

# A configured maximum range is kept if no plot lies beyond it and it is below this many times the
# range of the farthest plot.
MOST_BEYOND = 1.5
# Upper bounds of the shares of the clutter that are nearer than the minimum range, and obstructed.
MOST_NEAR, MOST_BLIND = 0.99, 0.99
# Clutter counts as noise if its mean level is within this factor of the noise level.
NOISE_FACTOR = 1.25
MOST_PROBABILITY = 0.999
SHORTEST_LOOK_S = 1e-3  # The smallest interval_s
# The parameters of the noise.
NOISE = ("range_std", "azimuth_std_deg")
# The engine whose measurement noise may have outliers.
GAUSSIAN = "gaussian"

# Returns the current value of a radar's parameter, None if none is set.
Now = Callable[[str], Any]


@dataclass(frozen=True)
class Row:
    """A figure estimated from a recording."""

    name: str  # The parameter, or a description if no parameter follows from the figure
    value: Value
    source: str  # The data it was estimated from
    now: Any = None  # The current value, or words for it; None if none is set
    std: float = math.nan  # Standard deviation; NaN if there is none
    proposed: bool = True  # True if the value is proposed for the parameter


def rows(found: Findings, values: Mapping[str, Any], radar: str) -> list[Row]:
    """Return the figures of a radar; `values` has all parameters of the current configuration."""

    def now(name: str) -> Any:
        return values.get(f"{radar}.{name}")

    gaussian = values.get("engine", GAUSSIAN) == GAUSSIAN
    noise = found.likelier_noise if gaussian else found.noise
    by_band = found.levels is not None and values.get("amplitude", "none") != "none"
    if found.of_places:
        return [*_of_places(found, noise, now), *_amplitudes(found, now), *_motion(found)]
    max_range, fov = _max_range(found, now("max_range")), [*_fov(found, now)]
    detection = [*_detection(found, now, by_band)]
    return [
        *_rotation(found, now),
        *_learned(found, noise, now),
        *_noise(found, noise, now),
        *_elevations(found, now),
        *_motion_noise(found, now, "range_rate_std"),
        *_clusters(found, now),
        *detection,
        max_range,
        *_clutter(found, now, max_range.value if max_range.proposed else max_range.now, fov),
        *_clutter_map(found, now, knows_rest(values)),
        *fov,
        *_amplitudes(found, now),
        *_motion(found),
    ]


def interval_s(found: Mapping[str, Findings]) -> float:
    """Return the nominal interval: the shortest time between two looks of a radar, seconds.

    Raise `TuningError` if no radar looks as often.
    """
    shortest = min(each.timing.look_s for each in found.values())
    if shortest < SHORTEST_LOOK_S:
        raise TuningError(
            f"scans follow each other in {shortest:.2g} s, must be at least {SHORTEST_LOOK_S:g} s: "
            "times are in seconds; these are probably hours or days: multiply them by 3600 or 86400"
        )
    return round_to_std(shortest, 1e-3 * shortest)


def _tracks(found: Findings) -> str:
    return f"{found.noise.plots} plots, {found.tracks} tracks"


def _rotation(found: Findings, now: Now) -> Iterator[Row]:
    timing = found.timing
    source = f"{found.looks:.0f} revolutions"
    if timing.rotation_s:
        period, std = round_to_std(timing.rotation_s, timing.rotation_std_s), timing.rotation_std_s
        yield Row("rotation_s", period, source, now("rotation_s"), std)
        if not timing.timed or now("sectors"):
            yield Row("sectors", timing.sectors, source, now("sectors"))
    elif given := now("rotation_s"):
        # The rotation is not observable from plots that share one time.
        note = "as configured: not observable from the plots"
        yield Row("rotation_s", given, note, given, proposed=False)


def _of_places(found: Findings, noise: Noise, now: Now) -> Iterator[Row]:
    """Yield the figures of a sensor of positions.

    Its noise is the same along both axes; the larger of the two that were found counts, because a
    smaller one breaks tracks. It goes on learning what depends on the place and the time of day.
    """
    given = now("learn")
    if noise.outliers and "outliers" not in (given or ()):
        words = [*(("noise", "detection", "clutter") if given is None else given), "outliers"]
        yield Row("learn", words, _tracks(found), given)
    value, std = noise.range_std, noise.range_std * float(noise.log_std.max())
    value = max(value, noise.azimuth_std)
    yield Row("position_std", round_to_std(value, std), _tracks(found), now("position_std"), std)
    yield from _motion_noise(found, now, "velocity_std")
    yield from _clusters(found, now)
    rate = found.detection
    probability = min(round_to_std(rate.value, 0.01), MOST_PROBABILITY)
    source = f"{rate.count} looks"
    yield Row("detection_probability", probability, source, now("detection_probability"), rate.std)
    area, given = found.field.area, now("area")
    source = f"{found.plots} plots"
    yield Row("area", [*area], source, given, proposed=not covers(given, area, MOST_BEYOND))
    clutter = found.clutter
    value, source = round_to_std(clutter.value, clutter.std), f"{clutter.count} untracked plots"
    yield Row("clutter_rate", value, source, now("clutter_rate"), clutter.std)


def _motion_noise(found: Findings, now: Now, name: str) -> Iterator[Row]:
    """Yield the noise of velocities or range rates."""
    if found.velocity is not None:
        speed = found.velocity.noise
        source = f"{speed.count} plots of tracks"
        # The parameter has no smaller values than this one.
        shown = max(round_to_std(speed.value, speed.std), 1e-3)
        yield Row(name, shown, source, now(name), speed.std)


def _learned(found: Findings, noise: Noise, now: Now) -> Iterator[Row]:
    """Yield what the tracker still has to learn besides the estimated values."""
    given = now("learn") or []
    estimated = {"outliers", "detection", "correlation"}
    if found.velocity is not None or not now("fields.range_rate"):
        estimated.add("noise")
    words = [word for word in given if word not in estimated] + ["outliers"] * noise.outliers
    if words != given:
        yield Row("learn", words, "the other values are estimated", given)


def _noise(found: Findings, noise: Noise, now: Now) -> Iterator[Row]:
    least = LEAST_STD if now("geodetic") else (0.0, 0.0)
    figures = zip((noise.range_std, noise.azimuth_std), least, noise.log_std, strict=True)
    for name, (measured, lowest, log_std) in zip(NOISE, figures, strict=True):
        unit = 1.0 if name == "range_std" else math.degrees(1.0)
        value, std = unit * measured, unit * measured * float(log_std)
        shown, source = round_to_std(value, std), _tracks(found)
        if lowest > measured:
            source = f"{source} show {shown:g}; raised to the smallest plausible value"
            shown, std = round_to_std(unit * lowest, 0.0), math.nan
        yield Row(name, shown, source, now(name), std)


def _elevations(found: Findings, now: Now) -> Iterator[Row]:
    """Yield the noise of elevations, and their limits, widened by half a degree on each side."""
    if (own := found.elevations) is None:
        return
    value, std = math.degrees(own.noise.value), math.degrees(own.noise.std)
    source, name = f"{own.noise.count} elevations of tracks", "elevation_std_deg"
    yield Row(name, round_to_std(value, std), source, now(name), std)
    low, high = (math.degrees(edge) for edge in own.limits)
    limits = [max(math.floor(2.0 * low) / 2.0 - 0.5, -90.0)]
    limits.append(min(math.ceil(2.0 * high) / 2.0 + 0.5, 90.0))
    name, given = "fov_elevation_deg", now("fov_elevation_deg")
    # A configured field that contains them and is not much larger is kept.
    kept = bool(given) and given[0] <= low and high <= given[1]
    kept = kept and given[1] - given[0] <= MOST_BEYOND * (limits[1] - limits[0])
    yield Row(name, limits, f"{found.plots} plots", given, proposed=not kept)


def _clusters(found: Findings, now: Now) -> Iterator[Row]:
    """Yield the distance that merges the plots of a target that lie within their noise."""
    given, copies = now("cluster_distance"), found.copies
    if copies is not None and copies.distance and not given:
        value = round_to_std(copies.distance, 0.1 * found.noise.range_std)
        yield Row("cluster_distance", value, f"{len(copies.rows)} copies of plots", given)
    elif found.beside > MOST_BESIDE and not given:
        source = (
            f"{100.0 * min(found.beside, 1.0):.0f} % of tracked plots have another one beside them"
        )
        value = round_to_std(found.noise.range_std, 0.1 * found.noise.range_std)
        yield Row("cluster_distance", value, source, given)


def _max_range(found: Findings, limit: float | None) -> Row:
    farthest = round_up(found.field.max_range)
    proposed = limit is None or not farthest <= limit <= MOST_BEYOND * farthest
    return Row("max_range", farthest, f"{found.plots} plots", limit, proposed=proposed)


def _clutter(found: Findings, now: Now, max_range: Any, fov: Sequence[Row]) -> Iterator[Row]:
    rate, given = found.clutter, now("clutter_rate")
    source = f"{rate.count} untracked plots"
    # The rate also counts the clutter nearer than the minimum range and in blind sectors, which
    # was not read.
    near = min((now("min_range") or 0.0) / found.field.clutter_range, MOST_NEAR)
    arc: Any = fov[0].value if fov else now("fov_deg") or RadarParameters().fov_deg
    whole = 1.0 / ((1.0 - near) * _clear_share(arc, now("blind_sectors_deg") or ()))
    value = round_to_std(whole * rate.value, whole * rate.std)
    # A rate that the tracker learns is not replaced, but it needs one to begin with.
    learned = "clutter" in (now("learn") or ())
    proposed = given is None or not learned
    yield Row("clutter_rate", value, source, given, whole * rate.std, proposed)
    step = 0.01 * round_up(found.field.max_range)
    clutter_range = round_to_std(found.field.clutter_range, step)
    value, given = min(clutter_range, max_range), now("clutter_max_range")
    if found.clutter_density is not None:
        ranges, density = found.clutter_density
        step = 0.01 * float(ranges[-1])
        table = {
            "clutter_density": [round_to_std(each, 0.1 * each) for each in density.tolist()],
            "clutter_density_range": [round_to_std(each, step) for each in ranges.tolist()],
        }
        for name, column in table.items():
            yield Row(name, column, source, now(name))
    # A learned rate is learned within the limit that is set.
    kept = learned and value <= (given or 0.0) <= MOST_BEYOND * value
    yield Row("clutter_max_range", value, source, given, proposed=not kept)


def _clutter_map(found: Findings, now: Now, knows_rest: bool) -> Iterator[Row]:
    if found.slow_speed and not knows_rest:
        source = f"{100.0 * found.resting:.0f} % of plots in recurring places"
        yield Row("clutter_map", True, source, now("clutter_map"))
        speed, own = map_speed(found, now), f"slow targets move at {found.slow_speed:.2g} m/s"
        if speed != _given_speed(now):
            yield Row("clutter_map_speed", speed, own, now("clutter_map_speed"))
    elif found.crowded > MOST_CROWDED:
        source = f"{100.0 * found.crowded:.0f} % of plots in areas of dense clutter"
        yield Row("clutter_map", True, source, now("clutter_map"))
        if not now("clutter_map"):
            # This clutter does not recur in the same places, so a stationary track is a target.
            yield Row("clutter_map_speed", 0.0, source, now("clutter_map_speed"))


def knows_rest(values: Mapping[str, Any]) -> bool:
    """Return whether a class of a configuration is only stationary, which then decides."""
    motions = [values.get(f"{name}.motions") or () for name in values.get("classes", ())]
    # The motion model of a class of things at rest.
    return any(
        own and all(values.get(f"{motion}.model") == "stationary" for motion in own)
        for own in motions
    )


def _given_speed(now: Now) -> float:
    """Return the given speed below which a map hides targets, m/s, or else the default one."""
    given = now("clutter_map_speed")
    return RadarParameters().clutter_map_speed if given is None else float(given)


def map_speed(found: Findings, now: Now) -> float:
    """Return a speed below which a map hides no moving target, m/s."""
    # Upper bound of a clutter map's speed, as a share of the speed of slow targets.
    slow = 0.5 * found.slow_speed
    return min(_given_speed(now), round_to_std(slow, 0.5 * slow))


def _clear_share(fov: Sequence[float], blind: Sequence[float]) -> float:
    """Return the share of a field of view outside blind sectors, which are given by their edges."""
    width = (fov[1] - fov[0]) % 360.0 or 360.0
    azimuth = fov[0] + np.linspace(0.0, width, 3601)[:, None]
    begin, end = np.reshape(blind, (-1, 2)).T
    clear = ((azimuth - begin) % 360.0 > (end - begin) % 360.0).all(axis=1)
    return max(float(clear.mean()), 1.0 - MOST_BLIND)


def _detection(found: Findings, now: Now, by_band: bool) -> Iterator[Row]:
    """Yield the detection probability; a configured table that agrees is kept.

    SNR bands are kept too, unless the tracker has learned by which factor they are wrong.
    """
    # A configured table of detection probability over range is kept if the estimate lies within its
    # values, plus or minus this.
    same_probability = 0.05
    rate, name = found.detection, "detection_probability"
    value = min(round_to_std(rate.value, 0.01), MOST_PROBABILITY)
    given, learned, source = now(name), "detection" in (now("learn") or ()), f"{rate.count} looks"
    if isinstance(given, list):
        agrees = min(given) - same_probability <= value <= max(given) + same_probability
        table = f"table, {np.mean(given):.3g}"
        yield Row(name, value, source, table, rate.std, not agrees)
        if not agrees:
            ranges = f"{name}_range"
            yield Row(ranges, [], "one probability for all ranges", now(ranges))
        return
    if by_band and not learned:
        given = "from SNR bands"
    yield Row(name, value, source, given, rate.std, learned or not by_band)


def _amplitudes(found: Findings, now: Now) -> Iterator[Row]:
    levels = found.levels
    if levels is None:
        yield Row("amplitudes", "none", f"{found.plots} plots", proposed=False)
        return
    alarm, name = levels.false_alarm_probability, "false_alarm_probability"
    known = levels.noise_is_known
    value = round_to_std(alarm, 0.1 * alarm)
    source = f"{levels.clutter + levels.targets} amplitudes"
    yield Row(name, value, source, now(name), proposed=known)
    if levels.clutter and known:
        noise = 1.0 / NOISE_FACTOR <= levels.excess <= NOISE_FACTOR
        law, name = "rayleigh" if noise else "learned", "clutter_amplitude"
        # A configured clutter law stays if the recording shows only noise.
        source = f"{levels.clutter} untracked plots"
        yield Row(name, law, source, now(name), proposed=not noise)
    low, high = levels.target_db
    if math.isfinite(low):
        band = [round(low, 1), round(high, 1)]
        yield Row("tracks' SNR, dB", band, f"{found.tracks} tracks", proposed=False)


def _motion(found: Findings) -> Iterator[Row]:
    """Yield the targets' speeds and accelerations, which the motion models must cover."""
    speed = round_to_std(found.speed_std * math.sqrt(2.0), 0.1)
    yield Row("speeds, m/s", speed, _tracks(found), proposed=False)
    densities = [round_to_std(density, 0.1 * density) for density in found.noise.densities]
    yield Row("accelerations, m^2/s^3", densities, _tracks(found), proposed=False)


def _fov(found: Findings, now: Now) -> Iterator[Row]:
    """Yield the field of view in the radar's convention, widened by two degrees on each side."""
    if found.field.arc is None:
        return
    arc = found.field.arc
    begin, width = math.degrees(arc[0]) - 2.0, min(math.degrees(arc[1]) + 4.0, 360.0)
    if now("units.azimuth_convention") == "compass_cw":
        begin = 90.0 - begin - width
    begin = round((begin + 180.0) % 360.0 - 180.0, 1)
    value = [begin, round(begin + width, 1)]
    yield Row("fov_deg", value, f"{found.plots} plots", now("fov_deg"))
