"""Findings as tracker parameters: proposed value, standard deviation and current value.

A recording without a configuration gets one class, born at detections.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import Value
from phd_jdtc_ros.core.sensors.site import LEAST_STD

from .findings import (
    FASTEST,
    LEAST_DENSITY,
    MOST_BESIDE,
    MOST_CROWDED,
    MOST_LAND,
    SPEED_MARGIN,
    Findings,
    TuningError,
)
from .noise import Noise
from .rates import MARGIN

# Plausible false alarm probabilities of a receiver; outside them the noise level is unknown.
ALARMS = (1e-12, 0.5)
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
# Causes of velocities that are so many times the changes of lengths.
UNITS = {
    "{what} are in feet": 0.3048,
    "{what} are in kilometres, or times in milliseconds": 1000.0,
    "{what} are in nautical miles": 1852.0,
    "{own} are in km/h": 3.6,
    "{own} are in knots": 1.9438,
    "{own} are in feet per second": 3.2808,
    "{own} are in miles per hour": 2.2369,
}

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
        *_clutter_map(found, now, _knows_rest(values)),
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
    yield Row("area", [*area], source, given, proposed=not _covers(given, area))
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


def _covers(given: Any, area: Sequence[float]) -> bool:
    """Return whether a configured rectangle contains the places and is not much larger."""
    if not isinstance(given, (list, tuple)) or len(given) != len(area):
        return False
    own, found = np.reshape(given, (2, 2)), np.reshape(area, (2, 2))
    # The area that was found is larger than that of the places.
    inner = 0.5 * (found[0] + found[1]) + (found - 0.5 * (found[0] + found[1])) / MARGIN
    contains = (own[0] <= inner[0]).all() and (own[1] >= inner[1]).all()
    return bool(contains and np.ptp(own, axis=0).prod() <= MOST_BEYOND**2 * np.ptp(found, 0).prod())


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
    farthest = _round_up(found.field.max_range)
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
    step = 0.01 * _round_up(found.field.max_range)
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
        speed, own = _map_speed(found, now), f"slow targets move at {found.slow_speed:.2g} m/s"
        if speed != _given_speed(now):
            yield Row("clutter_map_speed", speed, own, now("clutter_map_speed"))
    elif found.crowded > MOST_CROWDED:
        source = f"{100.0 * found.crowded:.0f} % of plots in areas of dense clutter"
        yield Row("clutter_map", True, source, now("clutter_map"))
        if not now("clutter_map"):
            # This clutter does not recur in the same places, so a stationary track is a target.
            yield Row("clutter_map_speed", 0.0, source, now("clutter_map_speed"))


def remarks(found: Findings, values: Mapping[str, Any], radar: str) -> Iterator[str]:
    """Yield a sentence about each decision that a user may want to change.

    `values` has the parameters that the user has given; see `rows`.
    """

    def now(name: str) -> Any:
        return values.get(f"{radar}.{name}")

    yield from _units(found)
    if found.elevations is not None and now("units.elevation") in (None, "rad", "deg", "mrad"):
        low, high = (math.degrees(edge) for edge in found.elevations.limits)
        if low > 30.0 and high > 80.0:
            yield (
                f"elevations are from {low:.0f} to {high:.0f} degrees above the horizon; if they "
                f"are angles from the zenith, set {radar}.units.elevation to zenith_rad or "
                "zenith_deg"
            )
        elif low < -10.0 and high < 1.0:
            yield (
                f"elevations are from {low:.0f} to {high:.0f} degrees; if they count downwards, "
                f"set {radar}.units.elevation to down_rad or down_deg"
            )
    copies = found.copies
    if copies is not None and copies.delay_s:
        yield (
            f"{len(copies.rows)} detections are copies of others, {copies.delay_s:.3g} s later at "
            "the same place with the same errors; each target may have several tracks. Leave the "
            "copies out; is every plot recorded twice?"
        )
    elif copies is not None and now("cluster_distance") is None:
        yield (
            f"{len(copies.rows)} detections are copies of others, {copies.distance:.3g} m away in "
            f"the same scan with the same errors; {radar}.cluster_distance now merges what is no "
            "farther apart. Is every plot recorded twice, or are two recordings joined?"
        )
    elif found.beside > MOST_BESIDE and now("cluster_distance") is None:
        yield (
            f"{100.0 * min(found.beside, 1.0):.0f} % of the tracked detections have another one "
            f"within their noise in the same scan; {radar}.cluster_distance now merges those that "
            "are no farther apart than it and their noise. Is every plot recorded twice?"
        )
    if found.resting <= MOST_LAND or now("clutter_map") is not None or _knows_rest(values):
        return
    begin = f"{100.0 * found.resting:.0f} % of the detections are in recurring places"
    if not found.slow_speed:
        yield (
            f"{begin}, and may be of targets at rest, which are tracked; set {radar}.clutter_map "
            "to true if they are clutter"
        )
    elif speed := _map_speed(found, now):
        yield (
            f"{begin}, which clutter_map: true takes for clutter: targets slower than {speed:g} "
            f"m/s are not reported; set {radar}.clutter_map_speed to 0 if they are ships at anchor"
        )


def _units(found: Findings) -> Iterator[str]:
    """Yield a sentence if speeds show that lengths, times or velocities are in other units."""
    what, own = ("x and y", "velocities") if found.of_places else ("ranges", "range rates")
    corners = np.reshape(found.field.area or (0.0, found.field.max_range), (2, -1))
    extent, speed = float(np.ptp(corners, axis=0).max()), math.sqrt(2.0) * found.speed_std
    ratio = math.nan if found.velocity is None else found.velocity.ratio
    # By less, slopes of positions may be wrong because targets turn.
    if ratio < 0.8 or ratio > 1.25:
        fits = [each for each, of in UNITS.items() if 0.95 < abs(ratio) / of < 1.05]
        causes = [each.format(what=what, own=own) for each in fits]
        causes += [f"{own} are positive for what approaches"] * (ratio < 0.0)
        yield (
            f"{own} are {ratio:.3g} times the changes of {what}, so that they contradict each "
            f"other; probably {' and '.join(causes) or 'one of them is in another unit'}: metres "
            "and metres per second are expected"
        )
    # A slower pedestrian stands, and who looks at such things looks at 500 m at most.
    elif extent < 500.0 and speed < 0.5 and found.movers:
        yield (
            f"{what} extend over {extent:.3g} m and targets move at {speed:.2g} m/s; if {what} are "
            "in kilometres, multiply them by 1000, and if in nautical miles by 1852"
        )
    elif speed > FASTEST:
        yield (
            f"targets move at {speed:.2g} m/s; if times are in minutes, multiply them by 60, and "
            f"if {what} are in centimetres or millimetres, divide them by 100 or 1000"
        )


def _knows_rest(values: Mapping[str, Any]) -> bool:
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


def _map_speed(found: Findings, now: Now) -> float:
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
    known = ALARMS[0] <= alarm <= ALARMS[1]
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


def round_to_std(value: float, std: float) -> float:
    """Return a value rounded to a twentieth of its standard deviation, and to five digits."""
    if not (math.isfinite(value) and value):
        return 0.0
    digits = 5
    if std > 0.0:
        digits = min(max(math.ceil(math.log10(abs(value) / std) + 1.3), 2), 5)
    return float(f"{value:.{digits}g}")


def _round_up(value: float) -> float:
    """Return a value rounded up to two digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.6g}")


# Looks of the smoother's lag, and least displacement by acceleration in this time, as a share of
# the range's standard deviation. As displacement in a single look, it would exceed the
# accelerations of slow targets by far where looks are frequent.
LAG_LOOKS, LEAST_OFF_COURSE = 5.0, 0.1
# Least standard deviation of the heights of undetected targets, metres, and their floor in standard
# deviations below the mean.
LEAST_HEIGHT_STD, FLOOR_SIGMA = 5.0, 3.0


def unspecified(found: Mapping[str, Findings]) -> dict[str, Any]:
    """Return the tracker's parameters outside the sections of at least one radar."""
    first = min(found.values(), key=lambda each: each.timing.look_s)
    look_s = first.timing.look_s
    turning = [each.timing.rotation_s for each in found.values() if each.timing.rotation_s]
    noise = first.likelier_noise
    floor = 3.0 * (LEAST_OFF_COURSE * noise.range_std) ** 2 / (LAG_LOOKS * look_s) ** 3
    calm = max(noise.densities[0], floor, LEAST_DENSITY)
    hard = max(noise.densities[1], calm)
    given: dict[str, Any] = {
        "engine": "gaussian",
        "interval_s": round_to_std(look_s, 1e-3 * look_s),
        "lag_s": round_to_std(LAG_LOOKS * look_s, 0.1 * look_s),
        "classes": ["target"],
        "births": [],
        # In a look of a fast sensor hardly any target is new: a false detection is no target there.
        "detection_births.rates": [round(0.2 * min(look_s, 1.0), 4)],
        "detection_births.std": [round_to_std(SPEED_MARGIN * first.speed_std, 0.1), 0.02],
        "spawn.rate": 0.0,
        "target.survival_probability": _survival_probability(found, look_s),
    } | _three_motions(calm, hard)
    heights = [each.elevations.heights for each in found.values() if each.elevations]
    if heights:
        own = heights[0]
        std = max(own[1], LEAST_HEIGHT_STD)
        floor = own[0] - FLOOR_SIGMA * std
        given["height_prior"] = [round_to_std(each, 0.1 * std) for each in (own[0], std, floor)]
    if turning:
        given["estimates_period_s"] = given["interval_s"]
    return given | _amplitude_band(found)


def _three_motions(calm: float, hard: float) -> dict[str, Any]:
    """Return straight motion, turns and rare manoeuvres, as in the profile for air traffic.

    Speeds change as little in turns as in straight motion, by the `calm` level of accelerations,
    m^2/s^3. Manoeuvres have the `hard` one, which braking and accelerating need.
    """
    names = ["cv", "ct", "hard"]
    turn = {"model": "coordinated_turn", "turn_time_constant_s": 40.0}
    by_motion = {
        "cv": {"model": "constant_velocity", "noise_density": round_to_std(calm, calm)},
        "ct": {**turn, "noise_density": round_to_std(calm, calm), "turn_noise_density": 1e-4},
        "hard": {**turn, "noise_density": round_to_std(hard, hard), "turn_noise_density": 2e-3},
    }
    return {
        "motions": names,
        "target.motions": names,
        "target.mode_transition": [0.949, 0.05, 0.001, 0.1, 0.899, 0.001, 0.1, 0.1, 0.8],
        **{f"{name}.{key}": each for name in names for key, each in by_motion[name].items()},
    }


def _survival_probability(found: Mapping[str, Findings], look_s: float) -> float:
    """Return the probability that a target survives a look of a length in seconds.

    Each radar's tracks bound the rate of disappearances from above; the lowest bound counts.
    """
    rate = min(each.ends.value / each.timing.look_s for each in found.values())
    # Least probability that a target survives a look. Lost tracks would make a lower one too low.
    return max(0.99, round(1.0 - round_to_std(rate * look_s, rate * look_s), 6))


def _amplitude_band(found: Mapping[str, Findings]) -> dict[str, Any]:
    """Return the band of the targets' SNRs if every radar's amplitudes exceed a threshold."""
    # The SNR band is wider than the tracks' levels by this much on either side, dB.
    beside_db = 5.0
    known = [each.levels for each in found.values() if each.levels is not None]
    usable = [
        levels
        for levels in known
        if ALARMS[0] <= levels.false_alarm_probability <= ALARMS[1]
        and math.isfinite(levels.target_db[0])
    ]
    if len(usable) < len(found):
        return {"amplitude": "none"}
    low = min(levels.target_db[0] for levels in usable) - beside_db
    high = max(levels.target_db[1] for levels in usable) + beside_db
    return {"amplitude": "band", "target.snr_band_db": [round(low, 1), round(high, 1)]}
