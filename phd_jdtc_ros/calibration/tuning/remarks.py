"""Remarks on findings: decisions that a user may want to change, and units that are wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .findings import FASTEST, MOST_BESIDE, MOST_LAND, Findings
from .proposal import knows_rest, map_speed

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


def remarks(found: Findings, values: Mapping[str, Any], radar: str) -> Iterator[str]:
    """Yield a sentence about each decision that a user may want to change.

    `values` has the parameters that the user has given; see `proposal.rows`.
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
    if found.resting <= MOST_LAND or now("clutter_map") is not None or knows_rest(values):
        return
    begin = f"{100.0 * found.resting:.0f} % of the detections are in recurring places"
    if not found.slow_speed:
        yield (
            f"{begin}, and may be of targets at rest, which are tracked; set {radar}.clutter_map "
            "to true if they are clutter"
        )
    elif speed := map_speed(found, now):
        yield (
            f"{begin}, which clutter_map: true takes for clutter: targets slower than {speed:g} "
            f"m/s are not reported; set {radar}.clutter_map_speed to 0 if they are ships at anchor"
        )


def _units(found: Findings) -> Iterator[str]:
    """Yield a sentence if speeds show that lengths, times or velocities are in other units."""
    what, own = ("x and y", "velocities") if found.of_places else ("ranges", "range rates")
    corners = np.reshape(found.field.area or (0.0, 0.0, *2 * (found.field.max_range,)), (-1, 2))
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
