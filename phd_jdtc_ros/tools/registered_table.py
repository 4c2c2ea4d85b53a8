"""The tables of `register`: errors with their deviations, and residuals before and after."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros.calibration.registration.filtering import KINDS
from phd_jdtc_ros.calibration.registration.result import RadarEstimate, Registration
from phd_jdtc_ros.configuration.build import TrackerConfig

# Of the tables, in characters: a line for each error.
WIDTH = 110
# The parameter of each kind of error, its unit there, and the digits that it is written with.
PARAMETERS = dict(
    zip(KINDS, ("range_bias", "range_gain", "azimuth_bias_deg", "time_offset_s"), strict=True)
)
DIGITS = {"range_bias": 1, "range_gain": 6, "azimuth_bias_deg": 4, "time_offset_s": 4}
SCALES = (1.0, 1.0, math.degrees(1.0), 1.0)
WORDS = {
    "range_bias": "a range bias",
    "range_gain": "a range gain",
    "azimuth": "a turn of the azimuths",
    "time_offset_s": "a time offset",
}


class Row(NamedTuple):
    """An error of a radar as a parameter.

    Parameters
    ----------
    radar, name : str
        The radar, and the parameter without it.
    value : float or None
        What corrects the radar; None where it is not told.
    std : float
    source : str
        What it is known from, or why it is not told.
    now : float
        What is set.
    """

    radar: str
    name: str
    value: float | None
    std: float
    source: str
    now: float


def told(found: RadarEstimate) -> tuple[str, ...]:
    """Return the parameters of the errors of a radar that are told."""
    known = zip(PARAMETERS.values(), found.std, strict=True)
    return tuple(name for name, std in known if np.isfinite(std))


def rows(found: Registration, parameters: Mapping[str, float], now: TrackerConfig) -> list[Row]:
    """Return every error of every radar."""
    every = []
    for each in found.radars:
        for kind, std, scale in zip(KINDS, each.std, SCALES, strict=True):
            name = PARAMETERS[kind]
            source = f"{each.tracks} common tracks, {each.plots} plots"
            if not np.isfinite(std):
                hidden = (each.name, kind) in found.hidden
                source = "not told" if hidden else "the reference: taken to be right"
            every.append(
                Row(
                    each.name,
                    name,
                    parameters.get(f"{each.name}.{name}") if np.isfinite(std) else None,
                    float(std) * scale,
                    source,
                    float(now.values[f"{each.name}.{name}"]),
                )
            )
    return every


def table(every: Sequence[Row]) -> Table:
    """Return the errors as a table."""
    shown = Table(title="systematic errors", title_justify="left")
    for name in ("radar", "parameter", "found", "+-", "known from", "now"):
        shown.add_column(name, no_wrap=name == "parameter")
    before = ""
    for row in every:
        if before and row.radar != before:
            shown.add_section()
        shown.add_row(
            row.radar if row.radar != before else "",
            row.name,
            "-" if row.value is None else f"{row.value:.{DIGITS[row.name]}f}",
            "" if math.isnan(row.std) else f"{row.std:.2g}",
            row.source,
            f"{row.now:g}",
        )
        before = row.radar
    return shown


def residuals(found: Registration) -> Table:
    """Return how far plots are from the targets as all radars see them, before and after."""
    shown = Table(title="residuals of plots, root mean square", title_justify="left")
    for name in ("radar", "range before, m", "after, m", "azimuth before, deg", "after, deg"):
        shown.add_column(name, justify="left" if name == "radar" else "right")
    for each in found.radars:
        cells = []
        for axis, digits, scale in ((0, 1, 1.0), (1, 3, math.degrees(1.0))):
            for error in (each.residuals.before, each.residuals.after):
                cells.append(f"{scale * np.sqrt(np.mean(error[:, axis] ** 2)):.{digits}f}")
        shown.add_row(each.name, *cells)
    return shown


def remarks(found: Registration) -> Iterator[str]:
    """Yield what a recording cannot tell, and why."""
    words = ", ".join(WORDS[kind] for kind in found.common)
    yield (
        f"{found.tracks} common tracks. Not to be seen where it is common to all radars: {words}; "
        f"{found.reference} is taken to be right there (--reference)."
    )
    for radar in dict.fromkeys(radar for radar, _ in found.hidden):
        kinds = [kind for name, kind in found.hidden if name == radar]
        names = ", ".join(PARAMETERS[kind] for kind in kinds)
        yield (
            f"{radar}: {names} not told: {found.hidden[radar, kinds[0]]}. What is set is taken to "
            "be right, and the other errors rest on that."
        )


def comments(every: Sequence[Row]) -> dict[str, str]:
    """Return the comments of the corrections in a parameter file, by dotted name."""
    return {
        f"{row.radar}.{row.name}": f"+-{row.std:.2g}; {row.source}"
        + (f"; was {row.now:g}" if row.now else "")
        for row in every
        if row.value is not None
    }
