"""Warnings of reports that are used but do not look as they are configured, live and offline."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

from phd_jdtc_ros.calibration.innovations import Fit
from phd_jdtc_ros.configuration.radar_input import RadarInput


def of(radar: RadarInput, counts: Mapping[str, int]) -> Iterator[str]:
    """Yield a warning for each doubt about a radar's reports that was counted."""
    for what, count in counts.items():
        yield _TEXTS[what](radar, count)


def no_amplitude(radar: RadarInput) -> str:
    """Return the warning of a radar whose messages have no amplitudes."""
    return (
        f"{radar.topic}: no field {radar.amplitude_field!r}; "
        "its amplitudes say nothing of the class"
    )


def turn_found(radar: RadarInput, turn_s: float) -> str:
    """Return the warning of a radar whose turn, in seconds, is not set and was found out."""
    return (
        f"{radar.topic}: its antenna turns in {turn_s:.3f} s, as its detections show; set "
        f"{radar.name}.rotation_s to know it from the start"
    )


def nothing_reported(scans: int) -> str:
    """Return the warning of a tracker that reports no target for a while."""
    return (
        f"no target in {scans} scans with detections; if there are any, check "
        "detection_probability (the SNR bands without it) and sectors, detection_births.rates or "
        "births, clutter_rate, the noise, and whether the stamps go with interval_s"
    )


def of_noise(fit: Fit) -> str | None:
    """Return the warning of a radar whose noise is not as its detections show; None if it is."""
    if fit.larger:
        factor, wrong = math.sqrt(fit.alone), "larger"
    elif fit.smaller:
        factor, wrong = 1.0 / math.sqrt(fit.expected), "smaller"
    else:
        return None
    ranges, azimuths = fit.axes
    return (
        f"innovations are {factor:.2g} times {wrong} than the noise says (ranges {ranges:.2g} and "
        f"azimuths {azimuths:.2g} of its deviations); check {fit.radar}.range_std and "
        "azimuth_std_deg, or the fields of deviations; tune finds them in a recording"
    )


def _beyond_a_turn(radar: RadarInput, count: int) -> str:
    """Return the doubt of azimuths that are no angles of one turn in radians."""
    cause = (
        f"its definition has radians, {radar.message} in degrees needs another driver"
        if radar.message == "radar_scan"
        else f"degrees, set {radar.name}.azimuth_unit to deg"
    )
    return f"{count} azimuths beyond 2 pi rad; probably {cause}"


def _missing(parameter: str, consequence: str) -> Callable[[RadarInput, int], str]:
    """Return what makes the doubt of clouds without a field that a parameter names."""

    def text(radar: RadarInput, count: int) -> str:
        return f"no field as {radar.name}.{parameter} names it; {consequence}"

    return text


def _heights_unknown(radar: RadarInput, count: int) -> str:
    return f"{count} detections of unknown height; {_without_height(radar)}"


def _height_missing(radar: RadarInput, count: int) -> str:
    return _missing("fields.height", _without_height(radar))(radar, count)


def _without_height(radar: RadarInput) -> str:
    """Return what is done with slant ranges where the height is not known."""
    if radar.site is None:
        return "slant ranges are used as ground ranges"
    if math.isnan(radar.assumed_height):
        return f"they count as at the antenna's height, set {radar.name}.assumed_height"
    return f"they count as at {radar.name}.assumed_height, {radar.assumed_height:g} m"


_TEXTS: Mapping[str, Callable[[RadarInput, int], str]] = {
    "azimuths_beyond_a_turn": _beyond_a_turn,
    "detections_repeated": lambda radar, count: (
        f"{count} detections that repeat another one of their report in all they say; each counts "
        "once. Does the driver send its buffer twice?"
    ),
    "heights_unknown": _heights_unknown,
    "deviations_unusable": lambda radar, count: (
        f"{count} deviations that are zero, negative or absurd; {radar.name}.range_std, "
        "azimuth_std_deg and range_rate_std are used for them"
    ),
    "range_rates_unusable": lambda radar, count: (
        f"{count} range rates that are infinite or absurd; their detections are used without them"
    ),
    "range_rates_beyond_ambiguity": lambda radar, count: (
        f"{count} range rates beyond {radar.name}.range_rate_ambiguity, "
        f"{radar.range_rate_ambiguity:g} m/s; they are used modulo it, is it right?"
    ),
    "sectors_unusable": lambda radar, count: (
        f"{count} clouds whose sector is not one whole number from 0 to "
        f"{max(radar.sectors - 1, 0)}; it is derived from their detections"
    ),
    "identities_unusable": lambda radar, count: (
        f"{count} codes or addresses that are no whole number of 12 and 24 bits; their detections "
        "are used without them"
    ),
    "time_missing": _missing("fields.time", "all its detections count as at the stamp"),
    "sector_missing": _missing("fields.sector", "the sector is derived from the detections"),
    "height_missing": _height_missing,
    "code_missing": _missing("fields.code", "its codes are unknown"),
    "address_missing": _missing("fields.address", "its addresses are unknown"),
    "kind_missing": _missing("fields.kind", "what saw its detections is supposed"),
    "range_std_missing": _missing("fields.range_std", "range_std is used"),
    "azimuth_std_missing": _missing("fields.azimuth_std", "azimuth_std_deg is used"),
    "range_rate_missing": _missing("fields.range_rate", "its range rates are unknown"),
    "range_rate_std_missing": _missing("fields.range_rate_std", "range_rate_std is used"),
    "clouds_missing": lambda radar, count: (
        f"{count} clouds missing by the stamps; lost, or the driver sends none where it sees "
        "nothing; no target there counts as missed"
    ),
    "sectors_repeated": lambda radar, count: (
        f"{count} clouds of azimuths that the antenna cannot have passed again; is "
        f"{radar.name}.rotation_s right, and sectors?"
    ),
    "sector_numbers_wrong": lambda radar, count: (
        f"{count} clouds whose detections are not in the sector that they name; sectors are "
        f"numbered from 0, from azimuth zero on, {max(radar.sectors, 1)} to a turn"
    ),
    "antenna_unclear": lambda radar, count: (
        f"{count} clouds whose detections are not where one antenna was at their times; are "
        f"{radar.name}.rotation_s and its fields.time right?"
    ),
    "times_disagree": lambda radar, count: (
        f"{count} detections whose times do not go with their azimuths; they are used as they are "
        "and say nothing of what the antenna passed"
    ),
    "detections_late": lambda radar, count: (
        f"{count} detections came after what the antenna passed at their times had been reported; "
        "they are used, and their targets counted as missed before"
    ),
    "slices_late": lambda radar, count: (
        f"{count} parts of turns came after their scans were closed; set reorder_s to the longest "
        "rotation_s of the radars"
    ),
    "late_reworked": lambda radar, count: (
        f"{count} clouds, or parts of turns, came after their scans were closed and were worked "
        "in; if many do, hold scans back with reorder_s or set late_reports: rework"
    ),
    "poses_extrapolated": lambda radar, count: (
        f"{count} clouds, or parts of turns, were later than the poses on {radar.pose_topic}; the "
        "platform is extrapolated with its last velocity"
    ),
    "sectors_not_configured": lambda radar, count: (
        "each cloud is of a part of the turn, and together they are of all of it; set "
        f"{radar.name}.rotation_s and {radar.name}.sectors, or what the antenna did not pass "
        "counts as missed"
    ),
    "fov_not_configured": lambda radar, count: (
        f"all its detections are within a part of the turn; if it sees no more, set "
        f"{radar.name}.fov_deg, or targets elsewhere count as missed"
    ),
    "slant_ranges": lambda radar, count: (
        "ranges are used as ranges over ground; an aircraft 10 km up at 15 km is 3.8 km off: set "
        f"{radar.name}.fields.height or fields.elevation"
    ),
}
