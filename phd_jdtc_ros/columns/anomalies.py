"""Warnings of reports that are used but contradict their configuration, live and offline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.calibration.registration.monitor import MeanResidual
from phd_jdtc_ros.configuration.parameters.position import PositionParameters
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.intake.poses import PoseFault
from phd_jdtc_ros.core.intake.scans import Reset
from phd_jdtc_ros.quoting import agreeing, counted

from .selection import NO_ANGLE, PADDING

# A radar is worse than configured if it detects targets with less than this share of the configured
# probability, or if its noise is larger by this factor, each with this many standard deviations.
WORSE_DETECTION, WORSE_NOISE, SURE = 0.75, 1.5, 3.0
# The warning ends beyond these bounds, so that it does not come and go with chance.
RECOVERED_DETECTION, RECOVERED_NOISE = 0.85, 1.3
# Anomalies of single detections, and of single clouds, of which a few are normal.
OF_DETECTIONS = frozenset(
    {
        *("azimuths_beyond_a_turn", "azimuths_in_gradians", "azimuths_in_mils"),
        *("azimuths_no_angles", "ranges_negative", "fields_swapped"),
        "detections_repeated",
        *("heights_unknown", "deviations_unusable", "identities_unusable", "range_rates_unusable"),
        "heights_unusable",
        *("elevations_unusable", "elevations_opposite", "elevations_unknown"),
        *("range_rates_beyond_ambiguity", "times_disagree", "detections_late"),
        *("velocities_unusable", "positions_far"),
    }
)
OF_CLOUDS = frozenset(
    {"positions_constant", "slices_late", "late_reworked", "poses_extrapolated", "areas_unusable"}
)
# Largest share of them that is normal, if it is not MANY: heights come with the replies of
# transponders, so that primary plots and false ones have none, and weak plots have no elevation. A
# cloud of a fixed size may be nearly all padding, but not always.
MANY = 0.05
NORMAL = {"heights_unknown": 0.5, "elevations_unknown": 0.5, f"dropped_{PADDING}": 0.9999}


# The shares of azimuths of a unit that show it, by what is said of the others of its turn.
UNITS_OF_AZIMUTHS = {
    "azimuths_in_gradians": {"azimuths_beyond_a_turn": 0.05},
    "azimuths_in_mils": {"azimuths_beyond_a_turn": 0.05, "azimuths_no_angles": 0.2},
}


def likely(counts: Mapping[str, float]) -> dict[str, Any]:
    """Return counts, or shares, without those of azimuths that another unit explains."""
    kept = {**counts}
    for unit, others in UNITS_OF_AZIMUTHS.items():
        for other, share in others.items():
            if unit in kept and other in kept:
                del kept[other if kept[unit] > share * kept[other] else unit]
    return kept


def of(sensor: SensorParameters, counts: Mapping[str, int]) -> Iterator[str]:
    """Yield a warning for each kind of anomaly in a sensor's reports.

    An anomaly without a text of its own is named, as in "3 positions implausible".
    """
    for what, count in counts.items():
        if what in _TEXTS:
            text = _TEXTS[what]
            if isinstance(text, str):
                yield agreeing(count, text).format(name=sensor.name, count=count)
            else:
                yield text(sensor, count)
        elif what in _MISSING:
            yield _missing(sensor, what.removesuffix("_missing"), _MISSING[what])
        else:
            yield f"{count} {_words(what)}"


def is_answered(sensor: SensorParameters, what: str) -> bool:
    """Return whether the configuration has what the warning about an anomaly asks for."""
    return (
        what == "heights_unknown"
        and isinstance(sensor, RadarParameters)
        and sensor.site is not None
        and sensor.assumed_height is not None
    )


def no_amplitude(radar: SensorParameters) -> str:
    """Return the warning about a radar whose messages have no amplitudes."""
    lack = f"no field {radar.fields.amplitude!r}" if radar.fields.amplitude else "no amplitudes"
    return f"{lack}; classification does not use its amplitudes"


POSE_FAULTS = {
    PoseFault.DUPLICATE: "duplicate stamp",
    PoseFault.LATE: "older than the previous pose",
    PoseFault.JUMP: "a jump from the previous pose; accepted once later poses continue from it",
    PoseFault.ORIENTATION: "its orientation is not a quaternion, or its z axis does not point up, "
    "as of a radar upside down or of a camera's optical frame",
    PoseFault.CIRCLE: "a transform whose parent is below its frame, which closes a circle",
}


def reparented(count: int = 1) -> str:
    """Return the warning that a frame of a radar's chain has two parents, or is on both topics."""
    often = f", {count} times" if count > 1 else ""
    return (
        "a frame of a radar's chain of transforms got another parent, or is on /tf and on "
        f"/tf_static{often}; the latest counts"
    )


def started_again(reset: Reset, jumps: int = 1) -> str:
    """Return the warning about a jump of the stamps, which is the largest of several `jumps`."""
    limit = ", more than max_gap_scans" if reset.ahead else ""
    more = f"; the largest of {jumps} jumps" if jumps > 1 else ""
    return f"{reset}{limit}: starting again{more}"


def apart(first_ns: int, last_ns: int) -> str:
    """Return the warning about a radar whose stamps are all outside the time of the others."""
    return (
        f"its stamps, from {first_ns * 1e-9:.3f} to {last_ns * 1e-9:.3f} s, are all before or "
        "after those of the other radars; is its clock right?"
    )


def clock_off(offset_s: float | None, others: str = "sensors", what: str = "reports") -> str:
    """Return the warning about a sensor whose stamps are ahead of those of others, seconds.

    `offset_s` is None if only some stamps were.
    """
    if offset_s is None:
        return (
            f"some stamps are far from those of the other {others}, because the clock is wrong for "
            f"a while or {what} come too late; these {what} are left out"
        )
    way = "ahead of" if offset_s > 0.0 else "behind"
    return (
        f"its stamps are {abs(offset_s):.1f} s {way} those of the other {others}: its {what} are "
        "left out until its clock is right"
    )


def revolution_found(radar: SensorParameters, revolution_s: float) -> str:
    """Return the warning about a radar whose rotation period, s, is estimated, not configured."""
    return (
        f"the estimated time of a revolution is {revolution_s:.3f} s; set "
        f"{radar.name}.rotation_s to use it from the start"
    )


def no_targets(scans: int) -> str:
    """Return the warning about a tracker that has reported no target for a while."""
    return (
        f"no target in {scans} scans with detections; if there are any, check "
        "detection_probability (the SNR bands without it) and sectors, detection_births.rates or "
        "births, clutter_rate, the noise, and whether the stamps match interval_s"
    )


def of_noise(fit: Fit) -> str | None:
    """Return the warning about a radar whose detections contradict its noise, None if they fit."""
    ways = (("larger", fit.too_small, fit.noise), ("smaller", fit.too_large, 1.0 / fit.noise))
    return "; ".join(_of_noise(fit, *way) for way in ways if way[1].any()) or None


def _of_noise(fit: Fit, wrong: str, which: BoolArray, factor: FloatArray) -> str:
    numbers = which.nonzero()[0].tolist()
    known = {**RadarParameters.noise_parameters, **PositionParameters.noise_parameters}
    names = [known.get(each, (f"{each}_std", ""))[0] for each in fit.components]
    deviations = ", ".join(
        f"{_plural(fit.components[k])} off by {fit.noise[k]:.2g} times {names[k]}" for k in numbers
    )
    checked = " and ".join(dict.fromkeys(names[k] for k in numbers))
    # The profile of a radar that sees vessels from bow to stern has such a deviation.
    stays = "; errors that stay, as within the extent of large targets, do not show here"
    stays *= wrong == "smaller"
    return (
        f"innovations are {factor[which].max():.2g} times {wrong} than the noise predicts "
        f"({deviations}{stays}); check {fit.radar}.{checked}, or the "
        "fields of standard deviations; tune finds them in a recording"
    )


def _plural(component: str) -> str:
    """Return the words for the values of a component: "ranges are", but "x is"."""
    return f"{component} is" if len(component) == 1 else f"{component}s are"


def of_registration(found: MeanResidual) -> str | None:
    """Return the warning about a radar that does not agree with others, None if it agrees."""
    (range_m, azimuth), (range_sigma_m, azimuth_sigma) = found.mean, found.sigma
    azimuth_deg, azimuth_sigma_deg = math.degrees(azimuth), math.degrees(azimuth_sigma)
    ranges = f"ranges {range_m:+.3g} m (sigma {range_sigma_m:.2g})"
    azimuths = f"azimuths {azimuth_deg:+.3g} degrees to the left (sigma {azimuth_sigma_deg:.2g})"
    shown = zip((ranges, azimuths), found.significant, strict=True)
    biased = ", ".join(text for text, significant in shown if significant)
    if not math.isnan(found.near):
        biased = f"{100.0 * found.near:.0f} % of the expected detections are near"
    return f"off the tracks that other radars see too: {biased}" if biased else None


def figures_of(sensor: str, figures: Mapping[str, float]) -> dict[str, float]:
    """Return the figures of a sensor among those of a step, by names without the sensor's."""
    own = f"{sensor}."
    return {name.removeprefix(own): each for name, each in figures.items() if name.startswith(own)}


def of_learned(figures: Mapping[str, float], warned: bool = False) -> str | None:
    """Return the warning about a radar that has proved worse than configured, or None.

    It depends on the radar's `figures_of` a step, and on whether it was worse until now.
    """
    worse = []
    least, most, sure = WORSE_DETECTION, WORSE_NOISE, SURE
    if warned:
        least, most, sure = RECOVERED_DETECTION, RECOVERED_NOISE, 0.0
    found = figures.get("detection_probability")
    if found is not None:
        given, std = (figures[f"detection_probability_{which}"] for which in ("set", "std"))
        if found < least * given and given - found > sure * std:
            worse.append(f"it detects targets with probability {found:.2f} instead of {given:.2f}")
    for component in _components("_noise_ratio", figures):
        ratio = figures[name := f"{component}_noise_ratio"]
        if ratio > most and ratio - 1.0 > sure * figures[f"{name}_std"]:
            worse.append(f"its {_words(component)} noise is {ratio:.2g} times the configured one")
    if not worse:
        return None
    return f"worse than configured, tracked with the learned values: {'; '.join(worse)}"


def of_changes(figures: Mapping[str, float]) -> str | None:
    """Return the warning about a radar that has changed, or None; see `of_learned`."""
    changed = []
    if "fewer_detections" in figures:
        changed.append("it detects fewer targets")
    for component in _components("_noisier", figures):
        changed.append(f"its {_words(component)} noise is larger")
    blind = figures.get("blind_azimuth_deg")
    if blind is not None:
        changed.append(f"it detects hardly anything about {blind:.0f} degrees from its x axis")
    return f"has changed: {'; '.join(changed)}" if changed else None


def _components(ending: str, figures: Iterable[str]) -> Iterator[str]:
    """Yield the components of which there is a figure with this ending."""
    return (name.removesuffix(ending) for name in figures if name.endswith(ending))


def _words(component: str) -> str:
    return component.replace("_", " ")


def _beyond_a_turn(radar: RadarParameters, count: int) -> str:
    if radar.units.in_degrees:
        azimuths = counted(count, "azimuth[s]")
        return f"{azimuths} beyond 400 degrees; are they degrees?"
    cause = (
        f"degrees, set {radar.name}.units.azimuth to deg"
        if radar.named_fields
        else f"the driver sends degrees, but {radar.message} is defined in radians"
    )
    return f"{counted(count, 'azimuth[s]')} beyond 2 pi rad; probably {cause}"


def _missing(sensor: SensorParameters, field: str, treatment: str) -> str:
    return f"the field named by {sensor.name}.fields.{field} is missing; {treatment}"


def _deviations_of(sensor: SensorParameters) -> str:
    """Return the words for what is unusable of a sensor's noise, and what replaces it."""
    *others, last = dict.fromkeys(name for name, _ in sensor.noise_parameters.values())
    instead = f"{', '.join(others)} and {last}" if others else last
    singular = "" if others else ", or covariance[s] that [is|are] not positive definite"
    return (
        f"standard deviation[s] that [is|are] zero, negative or absurd{singular}; "
        f"{sensor.name}.{instead} replace{'' if others else 's'} [it|them]"
    )


def _without_height(radar: Any) -> str:
    """Return the treatment of detections without a height."""
    if not isinstance(radar, RadarParameters):
        return "they are used without one"
    if radar.site is None:
        return "slant ranges are used as ground ranges"
    if radar.assumed_height is None:
        return f"the antenna's height is assumed, set {radar.name}.assumed_height"
    return f"{radar.name}.assumed_height, {radar.assumed_height:g} m, is assumed"


# The treatment of detections without a field that is configured, by anomaly.
_MISSING = {
    "time_missing": "the stamp is used for all its detections",
    "sector_missing": "the sector is derived from the detections",
    "code_missing": "its codes are unknown",
    "address_missing": "its addresses are unknown",
    "detection_type_missing": "its detection types are assumed",
    "range_std_missing": "range_std is used",
    "azimuth_std_missing": "azimuth_std_deg is used",
    "range_rate_missing": "its range rates are unknown",
    "range_rate_std_missing": "range_rate_std is used",
    **dict.fromkeys(("x_std_missing", "y_std_missing"), "position_std is used"),
    "correlation_missing": "errors in x and y are taken as independent",
    **dict.fromkeys(("vx_missing", "vy_missing"), "its velocities are unknown"),
    "velocity_std_missing": "velocity_std is used",
}
# The warnings by anomaly: a text with the number of cases and the sensor's name, or a function of
# the parameters of a sensor of the kind that has the anomaly, and of the number.
_TEXTS: Mapping[str, str | Callable[[Any, int], str]] = {
    "azimuths_beyond_a_turn": _beyond_a_turn,
    "azimuths_in_gradians": "{count} azimuth[s] from 360 to 400; if they are gradians, multiply "
    "them by 0.9, with units.azimuth deg",
    "azimuths_in_mils": "{count} azimuth[s] from 4096 to 6400; if they are mils, multiply them by "
    "2 pi / 6400, or by 0.001 if they are milliradians, with units.azimuth rad",
    "azimuths_no_angles": f"{{count}} azimuth[s] beyond {NO_ANGLE:g}, neither radians nor degrees; "
    "convert mils or the counts of an encoder, and let NaN stand for what is unknown",
    "ranges_negative": "{count} negative range[s], which [is|are] not used",
    "fields_swapped": "{count} detection[s] with azimuths that are no angles or negative ranges, "
    "and all ranges could be angles; are {name}.fields.range and fields.azimuth swapped?",
    "azimuths_in_radians": "all azimuths are within 6.3 degrees; probably radians, set "
    "{name}.units.azimuth to rad",
    "azimuths_in_turns": lambda radar, _: (
        f"azimuths fill the arc from 0 to 1 {'degree' if radar.units.in_degrees else 'rad'}, and "
        "none is outside; if they are turns, multiply them by 2 pi, with units.azimuth rad"
    ),
    "lengths_not_in_metres": "a name in {name}.fields has another unit than metres, in which "
    "ranges, x and y are used; convert them, or rename the field",
    "ranges_near": lambda radar, _: (
        f"all ranges are far below {radar.name}.max_range, {radar.max_range:g} m; ranges must be "
        "in metres"
    ),
    "detections_repeated": "{count} detection[s] that [repeats|repeat] another one of [its|their] "
    "report in every field; each is used once. Does the driver send its buffer twice?",
    "detections_twinned": "{count} detection[s] with another one of [its|their] scan within "
    "[its|their] noise, so that targets have two tracks; is every plot recorded twice? "
    "{name}.cluster_distance merges them",
    "reports_repeated": "{count} cloud[s] that [repeats|repeat] all detections of the cloud before "
    "under another stamp; [it is|they are] not used. Does the driver send its buffer twice?",
    "reports_nearly_repeated": "{count} cloud[s] that [repeats|repeat] the detections of the cloud "
    "before under another stamp, a little apart; targets may have several tracks. Is every cloud "
    "recorded twice?",
    "positions_constant": "{count} cloud[s] with a place of exactly the same numbers as before, "
    "such as -999 in both; unless measurements are rounded it is not used: let NaN stand for what "
    "is unknown",
    "heights_unknown": lambda radar, count: (
        f"{counted(count, 'detection[s]')} without a height; {_without_height(radar)}"
    ),
    "heights_unusable": "{count} height[s] that [is|are] infinite or absurd; [its detection is|"
    "their detections are] used without [it|them]",
    "deviations_unusable": lambda sensor, count: counted(count, _deviations_of(sensor)),
    "velocities_unusable": "{count} velocit[y|ies] that [is|are] infinite or absurd; [its "
    "detection is|their detections are] used without [it|them]",
    "areas_unusable": "{count} cloud[s] whose area_x_min, area_y_min, area_x_max and area_y_max "
    "are no area that is the same in all points; {name}.area replaces it",
    "positions_far": "{count} position[s] 1000 km or more from the sensor, where single precision "
    "rounds to 0.06 m or more; let the driver subtract a place nearby, and set position to it",
    "elevations_unusable": "{count} elevation[s] beyond the zenith, which [is|are] not used; if "
    "they are in degrees or milliradians, set {name}.units.elevation to deg or mrad",
    "elevations_opposite": "{count} elevation[s] outside {name}.fov_elevation_deg or below the "
    "floor of height_prior, whose opposite[ is|s are] not; if they are depression angles, set "
    "{name}.units.elevation to down_rad or down_deg",
    "elevations_unknown": "{count} detection[s] without an elevation (NaN, or 0 in a whole cloud), "
    "whose height[ is|s are] unknown; if {name} measures none, {name}.fields.elevation has to be "
    "empty",
    "range_rates_unusable": "{count} range rate[s] that [is|are] infinite or absurd; [its "
    "detection is|their detections are] used without [it|them]",
    "range_rates_beyond_ambiguity": lambda radar, count: (
        f"{counted(count, 'range rate[s]')} beyond {radar.name}.range_rate_ambiguity, "
        f"{radar.range_rate_ambiguity:g} m/s, which {agreeing(count, '[is|are]')} used modulo this "
        "value; is it right?"
    ),
    "sectors_unusable": lambda radar, count: (
        f"{counted(count, 'cloud[s]')} whose sector is not one whole number from 0 to "
        f"{max(radar.sectors - 1, 0)}; the sector is derived from the detections"
    ),
    "identities_unusable": "{count} code[s] or address[es] that [is no whole number|are not whole "
    "numbers] of 12 or 24 bits; [its detection is|their detections are] used without [it|them]",
    "height_missing": lambda radar, _: _missing(radar, "height", _without_height(radar)),
    "clouds_missing": "{count} cloud[ is|s are] missing by the stamps: [it was|they were] lost, or "
    "the driver sends no empty clouds; no target there counts as missed",
    "sectors_repeated": "{count} cloud[s] of azimuths that the antenna cannot have passed again "
    "yet; are {name}.rotation_s and sectors right?",
    "sector_numbers_wrong": lambda radar, count: (
        f"{counted(count, 'cloud[s]')} whose detections lie outside the cloud's sector; sectors "
        f"are numbered from 0 at azimuth zero, {max(radar.sectors, 1)} per revolution"
    ),
    "antenna_unclear": lambda radar, count: (
        f"{counted(count, 'cloud[s]')} whose azimuths and times do not fit one turning antenna; "
        f"are {radar.name}.rotation_s and {'fields.time' if radar.fields.time else 'sectors'} "
        "right?"
    ),
    "times_disagree": "{count} detection[s] whose time[ does|s do] not match [its azimuth|their "
    "azimuths]; [it is|they are] used unchanged, but not to estimate the antenna's motion",
    "detections_late": "{count} detection[s] arrived after the report of [its|their] part of the "
    "revolution; [it is|they are] used, but [its target|their targets] counted as missed before",
    "slices_late": "{count} part[s] of revolutions arrived after [its scan was|their scans were] "
    "closed; set reorder_s to the longest delay of the reports",
    "late_reworked": "{count} cloud[s], or part[s] of revolutions, arrived after [its scan "
    "was|their scans were] closed and [was|were] reprocessed; if there are many, delay scans with "
    "reorder_s",
    "poses_extrapolated": lambda radar, count: (
        f"{counted(count, 'cloud[s], or part[s] of revolutions, [is|are]')} later than the poses "
        f"on {radar.pose.topic}; the platform's pose is extrapolated with its last velocity"
    ),
    "sectors_not_configured": "each cloud covers a part of the revolution, and together they cover "
    "all of it; set {name}.rotation_s and {name}.sectors, or targets that the antenna has not "
    "passed count as missed",
    "fov_not_configured": "all its detections are within a part of the revolution; if its field of "
    "view is limited, set {name}.fov_deg, or targets outside it count as missed",
    "slant_ranges": "ranges are used as ground ranges, which puts an aircraft at 10 km height and "
    "15 km range 3.8 km off; set {name}.fields.height or fields.elevation, or state: "
    "space with the heights of targets in height_prior",
}
