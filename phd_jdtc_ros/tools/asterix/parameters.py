"""Proposes a tracker's parameters for the radars of a recording of ASTERIX.

The profile of air traffic is adapted to the recording. A comment beside each changed value gives
its origin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros import resources
from phd_jdtc_ros.asterix.plot_stream import RadarState
from phd_jdtc_ros.asterix_bridge import settings
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.core.sensors.site import MAX_SITE_DISTANCE
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments, proposed_file, tracker_params

from .. import recorded_plots

# The profile that is adapted, and the prefix of the radar's parameters in it.
PROFILE, PROFILE_RADAR = "air_traffic", "approach."
# Assumed place of a radar without a known one: latitude, longitude, height.
NOWHERE = (0.0, 0.0, 0.0)
# Largest range of a surface movement radar, metres, within which the earth is taken to be flat.
SURFACE_RANGE = 20e3
# Factors from the farthest and the nearest plot to the largest and the smallest range.
BEYOND, BEFORE = 1.1, 0.9
# Parameters that are estimated as `tune` does it, from this length of the recording, seconds, if it
# has enough tracks.
MEASURED = ("range_std", "azimuth_std_deg", "clutter_rate")
MEASURED_S, LEAST_TRACKS = 300.0, 10
# Plausible detection probabilities, and their assumed decrease per metre of range.
PROBABILITIES, FALL = (0.5, 0.99), 0.03 / 100e3
# Lower bounds of standard deviations: a lost track costs more than less smoothing.
LEAST_STD = {"range_std": 5.0, "azimuth_std_deg": 0.01}
# Clouds that are out of order by more than this, seconds, indicate a wrong clock.
MOST_DISORDER_S = 60.0
# Upper bound of `equipped_probability`.
MOST_EQUIPPED = 0.99


@dataclass
class Proposal:
    """Parameters with comments by name, and hints for the user.

    Parameters
    ----------
    apart : dict of name to values
        Parameters of radars that cannot be tracked with the others.
    """

    values: dict[str, Any]
    comments: dict[str, str] = field(default_factory=dict)
    apart: dict[str, dict[str, Any]] = field(default_factory=dict)
    hints: list[str] = field(default_factory=list)

    def set(self, name: str, value: Any, comment: str) -> None:
        """Set a value and its comment."""
        self.values[name], self.comments[name] = value, comment


def guessed(origin: Sequence[float]) -> bool:
    """Return whether a ``world_origin`` is the assumed place of a radar without a known one."""
    return tuple(origin) == NOWHERE


def propose(states: Sequence[RadarState], disorder_s: float) -> Proposal | None:
    """Return a tracker's parameters for the radars that sent reports; None without any.

    Parameters
    ----------
    disorder_s : float
        Largest difference between the newest stamp and the stamp of a later cloud.
    """
    active = sorted((s for s in states if s.reports), key=lambda s: s.plots, reverse=True)
    if not active:
        return None
    profile = from_arguments.load(resources.profile(PROFILE)[0])
    found = Proposal({k: v for k, v in profile.items() if not k.startswith(PROFILE_RADAR)})
    own = {
        name.removeprefix(PROFILE_RADAR): value
        for name, value in profile.items()
        if name.startswith(PROFILE_RADAR) and not name.endswith((".position", ".yaw_deg"))
    }
    for state in active:
        for name, value in own.items():
            found.values[f"{state.settings.name}.{name}"] = value
        _layout(found, state)
        _ranges(found, state, own)
    together = _place(found, active)
    found.values["sensors"] = [state.settings.name for state in together]
    _turns(found, together)
    _identities(found, together)
    if disorder_s > MOST_DISORDER_S:
        found.hints.append(
            f"clouds came {disorder_s:.0f} s after newer ones: the clock of a radar is wrong, and "
            "reorder_s is not set for it"
        )
    elif len(together) > 1 and disorder_s:
        comment = "so much older than others were clouds when they came"
        found.set("reorder_s", math.ceil(10.0 * disorder_s) / 10.0, comment)
    for state in active:
        if state not in together:
            _part(found, state.settings.name)
    return found


def measure(found: Proposal, bag: Path) -> None:
    """Set noise, clutter and detection probability of the radars from the plots in a bag."""
    config = tracker_params.config(found.values)
    recorded = recorded_plots.read(BagReader(bag), config, MEASURED_S)
    for radar, plots in recorded.plots.items():
        try:
            own = None if plots is None else findings(plots)
        except TuningError:
            own = None
        if own is None or own.tracks < LEAST_TRACKS:
            found.hints.append(
                f"{radar}: its noise cannot be estimated from {MEASURED_S:g} s of plots; that of "
                f"the profile {PROFILE} is used"
            )
            continue
        for row in proposal.rows(own, config.values, radar):
            if row.name in MEASURED and row.proposed and isinstance(row.value, float):
                value = max(row.value, LEAST_STD.get(row.name, 0.0))
                least = "; no less is believed" if value > row.value else ""
                said = f"measured: {row.value:g} by {row.source}{least}"
                found.set(f"{radar}.{row.name}", value, said)
        if math.isfinite(own.detection.value):
            _detect(found, radar, own.detection.value)


def _detect(found: Proposal, radar: str, measured: float) -> None:
    """Set detection probabilities that fall with the range from a measured mean.

    A constant probability would be too high at long ranges, where misses are correlated, and lose
    tracks.
    """
    least, most = PROBABILITIES
    far = found.values[f"{radar}.max_range"]
    near = min(max(measured, least), most)
    table = [0.0, round(near, 3), far, round(max(near - FALL * far, least), 3)]
    name = f"{radar}.detection_probability"
    found.set(name, table, f"measured: {measured:.3f}; the fall with the range is guessed")


def write(path: Path, head: str, found: Proposal) -> None:
    """Write a parameter file; `ConfigError` if a tracker would refuse it."""
    tracker_params.config(found.values)
    proposed_file.write(path, head, found.values, found.comments)
    with path.open("a", encoding="utf-8") as stream:
        for name, values in found.apart.items():
            stream.write(
                f"    # {name} cannot be placed relative to the others; its section would be\n"
            )
            lines = proposed_file.lines("", values, found.comments)
            stream.writelines(f"    # {line[4:]}\n" for line in lines if line.startswith("    "))


def _layout(found: Proposal, state: RadarState) -> None:
    """Set the layout of a radar's clouds."""
    radar, seen = state.settings.name, state.statistics
    found.values |= {
        f"{radar}.topic": settings.topic_of(radar),
        f"{radar}.frame": radar,
        f"{radar}.azimuth_convention": "enu_ccw",
    }
    known = {"height": seen.heights, "code": seen.codes, "address": seen.addresses}
    for name, count in {**known, "kind": seen.kinds}.items():
        if count:
            found.set(f"{radar}.fields.{name}", name, f"in {count} of {state.plots} plots")
    assembler = state.assembler
    by_sector = assembler.by_sector > assembler.by_time
    turn_s = round(assembler.turn_s, 4)
    if by_sector:
        found.values[f"{radar}.fields.sector"] = "sector"
        said = "the mean of its turns, by its sector crossings"
    elif assembler.finder.turn_s:
        said = "the mean turn, by azimuths and times of its plots"
    else:
        said = "as it was given, or as the radar says" if turn_s else "to be found by the tracker"
    found.set(f"{radar}.rotation_s", turn_s, said)
    sectors = assembler.sectors if by_sector else 0
    said = "clouds are sectors" if by_sector else "clouds are slices of time"
    found.set(f"{radar}.sectors", sectors, said)


def _ranges(found: Proposal, state: RadarState, own: dict[str, Any]) -> None:
    """Set a radar's ranges, and scale the profile's tables with them."""
    radar, seen = state.settings.name, state.statistics
    if not state.plots or not seen.farthest:
        return
    digit = 10.0 ** (math.floor(math.log10(seen.farthest * BEYOND)) - 1)
    most = math.ceil(seen.farthest * BEYOND / digit) * digit
    scale = most / own["max_range"]
    found.set(f"{radar}.max_range", most, f"its farthest plot is at {seen.farthest:.0f} m")
    found.set(f"{radar}.clutter_max_range", most, "as max_range")
    pairs = own["detection_probability"]
    scaled = [round(v * scale) * 1.0 if k % 2 == 0 else v for k, v in enumerate(pairs)]
    said = "guessed: the profile's, as far as max_range"
    found.set(f"{radar}.detection_probability", scaled, said)
    least = min(own["min_range"], float(math.floor(seen.nearest * BEFORE)))
    whose = "the profile's; " if least == own["min_range"] else ""
    found.set(f"{radar}.min_range", least, f"{whose}its nearest plot is at {seen.nearest:.0f} m")
    if seen.farthest <= SURFACE_RANGE:
        found.hints.append(
            f"{radar} sees {seen.farthest / 1e3:.1f} km: noise, detections, clutter and motions of "
            f"the profile {PROFILE} are for a long-range radar and may not fit; tune proposes "
            "others"
        )


def _place(found: Proposal, active: Sequence[RadarState]) -> list[RadarState]:
    """Set the radars' places on the earth; return the radars that can be tracked together."""
    known = [state for state in active if state.site]
    if not known:
        _guess(found, active[0])
        together = [active[0]]
    else:
        latitude, longitude, _ = known[0].site or NOWHERE
        origin = [latitude, longitude, 0.0]
        found.set("world_origin", origin, f"where {known[0].settings.name} stands, at sea level")
        plane = SystemPlane(origin)
        together = []
        for state in known:
            radar, site = state.settings.name, state.site or NOWHERE
            said = "as it was given" if state.settings.site else "by the radar itself (I034/120)"
            found.set(f"{radar}.geodetic", list(site), said)
            if np.hypot(*plane.to_plane(*site[:2])) <= MAX_SITE_DISTANCE:
                together.append(state)
    left = [state.settings.name for state in active if state not in together]
    if left:
        found.hints.append(
            f"{', '.join(left)}: cannot be placed relative to {together[0].settings.name}, because "
            "where they stand is not known, or too far away; only "
            f"{', '.join(s.settings.name for s in together)} is tracked. Set geodetic of each"
        )
    return together


def _guess(found: Proposal, state: RadarState) -> None:
    """Assume a place for a radar without a known one."""
    radar = state.settings.name
    if state.statistics.farthest <= SURFACE_RANGE:
        found.comments[radar] = "where it stands is not known; over so few km the earth is flat"
        return
    said = "guessed: where it stands is not known"
    found.set("world_origin", list(NOWHERE), said + "; latitudes and longitudes are not true")
    found.set(f"{radar}.geodetic", list(NOWHERE), said)
    found.hints.append(
        f"where {radar} stands is not known: shapes and distances are right on the round earth, "
        f"latitudes and longitudes are not; set {radar}.geodetic and world_origin"
    )


def _turns(found: Proposal, together: Sequence[RadarState]) -> None:
    """Set the times that depend on the longest turn."""
    turn_s = max(round(state.assembler.turn_s, 4) for state in together)
    if turn_s:
        found.set("interval_s", turn_s, "the longest turn")
        found.set("estimates_period_s", turn_s, "the longest turn")
        found.set("lag", f"{round(5.0 * turn_s, 4):g} s", "five of the longest turns")


def _identities(found: Proposal, together: Sequence[RadarState]) -> None:
    plots = sum(state.plots for state in together)
    identified = sum(state.statistics.identified for state in together)
    if identified:
        share = min(max(round(identified / plots, 2), 0.01), MOST_EQUIPPED)
        said = f"{identified} of {plots} plots have a code or an address"
        found.set("equipped_probability", share, said)


def _part(found: Proposal, radar: str) -> None:
    """Set a radar's parameters apart, which are not used."""
    names = [name for name in found.values if name.startswith(f"{radar}.")]
    found.apart[radar] = {name: found.values.pop(name) for name in names}
