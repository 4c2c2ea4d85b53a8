"""The tables of `register`: errors with standard deviations, and residuals before and after."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros.calibration.registration.filtering import KINDS
from phd_jdtc_ros.calibration.registration.solution import RadarEstimate, Registration
from phd_jdtc_ros.configuration.build import TrackerConfig

# Smallest width of the tables, characters, at which each error fits a line.
WIDTH = 110
# The entries of the parameter `biases`: their names, digits, and scales (degrees in radians).
NAMES = dict(zip(KINDS, ("range, m", "range gain, m/m", "azimuth, deg", "time, s"), strict=True))
DIGITS, SCALES = (1, 6, 4, 4), (1.0, 1.0, math.degrees(1.0), 1.0)
WORDS = {
    "range_bias": "a range bias",
    "range_gain": "a range gain",
    "azimuth": "a turn of the azimuths",
    "time_offset_s": "a time offset",
}


class Row(NamedTuple):
    """An entry of a radar's parameter `biases`."""

    radar: str
    name: str
    digits: int  # Decimals of the value
    value: float | None  # The correction; None if the bias is unobservable
    std: float
    source: str  # Number of tracks and plots used, or why it is unobservable
    now: float  # The configured value


def corrections(
    found: RadarEstimate, biases: Sequence[float], now: Sequence[float]
) -> list[float] | None:
    """Return the rounded `biases` of a radar; the configured ones if they are unobservable.

    It is None if all of them are unobservable.
    """
    observable = np.isfinite(found.std)
    entries = zip(observable, biases, now, DIGITS, strict=True)
    chosen = [
        round(bias, digits) + 0.0 if is_observable else old
        for is_observable, bias, old, digits in entries
    ]
    return chosen if observable.any() else None


def rows(
    found: Registration, parameters: Mapping[str, Sequence[float]], now: TrackerConfig
) -> list[Row]:
    """Return a row for each entry of each radar's `biases`."""
    result = []
    for each in found.radars:
        name = f"{each.name}.biases"
        biases, before = parameters.get(name, now.values[name]), now.values[name]
        entries = zip(KINDS, each.std, SCALES, DIGITS, biases, before, strict=True)
        for kind, std, scale, digits, value, old in entries:
            source = f"{each.tracks} common tracks, {each.plots} plots"
            if not np.isfinite(std):
                hidden = (each.name, kind) in found.hidden
                source = "not observable" if hidden else "the reference: taken to be right"
            result.append(
                Row(
                    each.name,
                    NAMES[kind],
                    digits,
                    value if np.isfinite(std) else None,
                    float(std) * scale,
                    source,
                    old,
                )
            )
    return result


def table(every: Sequence[Row]) -> Table:
    """Return the errors as a table."""
    shown = Table(title="systematic errors", title_justify="left")
    for name in ("radar", "bias", "found", "+-", "source", "now"):
        shown.add_column(name, no_wrap=name == "bias")
    before = ""
    for row in every:
        if before and row.radar != before:
            shown.add_section()
        shown.add_row(
            row.radar if row.radar != before else "",
            row.name,
            "-" if row.value is None else f"{row.value:.{row.digits}f}",
            "" if math.isnan(row.std) else f"{row.std:.2g}",
            row.source,
            f"{row.now:g}",
        )
        before = row.radar
    return shown


def residuals(found: Registration) -> Table:
    """Return the residuals of each radar's plots against the common tracks, before and after."""
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
    """Yield which errors are not observable, and why."""
    words = ", ".join(WORDS[kind] for kind in found.common)
    yield (
        f"{found.tracks} common tracks. Not observable where common to all radars: {words}; "
        f"{found.reference} is taken to be right there (--reference)."
    )
    for radar in dict.fromkeys(radar for radar, _ in found.hidden):
        kinds = [kind for name, kind in found.hidden if name == radar]
        names = " and ".join(NAMES[kind] for kind in kinds)
        yield (
            f"{radar}: {names} not observable: {found.hidden[radar, kinds[0]]}. The current values "
            "are taken to be right, and the other errors depend on them."
        )


def comments(every: Sequence[Row]) -> dict[str, str]:
    """Return the comments of the corrections in a parameter file, by dotted name."""
    found = {}
    for radar in dict.fromkeys(row.radar for row in every if row.value is not None):
        own = [row for row in every if row.radar == radar]
        stds = ", ".join("-" if row.value is None else f"{row.std:.2g}" for row in own)
        known = next(row.source for row in own if row.value is not None)
        before = f"; was {[row.now for row in own]}" if any(row.now for row in own) else ""
        found[f"{radar}.biases"] = f"+-[{stds}]; {known}{before}"
    return found
