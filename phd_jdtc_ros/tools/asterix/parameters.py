"""Proposes parameters for a recording of ASTERIX: the profile of air traffic, adapted to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.encoding import names
from phd_jdtc_ros import resources
from phd_jdtc_ros.asterix.messages import ADS_B, MULTILATERATION, TRACKS
from phd_jdtc_ros.asterix.plot_stream import RadarState
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import Findings, TuningError, findings
from phd_jdtc_ros.calibration.tuning.unspecified import unspecified
from phd_jdtc_ros.configuration.models import REPLY_PROBABILITY
from phd_jdtc_ros.core.sensors.site import MAX_SITE_DISTANCE
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files

from .. import recorded_plots

# The profile that is adapted, and the prefix of the radar's parameters in it.
PROFILE, PROFILE_RADAR = "air_traffic", "approach."
# Largest range of a radar of an airport's surface or a harbour, metres, within which the earth is
# taken to be flat, and targets not to be in flight.
SURFACE_RANGE = 20e3
# Factors from the farthest and the nearest plot to the largest and the smallest range.
MAX_RANGE_FACTOR, MIN_RANGE_FACTOR = 1.1, 0.9
# Parameters that are estimated as `tune` does it, from a recording that shows the noise.
ESTIMATED = ("range_std", "azimuth_std_deg", "clutter_rate")
OF_TARGETS = ("detection_births.std", *(f"{name}.noise_density" for name in ("cv", "ct", "hard")))
OVER_RANGE = ("clutter_density", "clutter_density_range")
# Plausible detection probabilities, and their assumed decrease per metre of range.
PROBABILITIES, PROBABILITY_SLOPE = (0.5, 0.99), 0.03 / 100e3


@dataclass
class Proposal:
    """Parameters with comments by name, and hints for the user."""

    values: dict[str, Any]
    comments: dict[str, str] = field(default_factory=dict)
    # Parameters of radars that cannot be tracked with the others.
    untracked: dict[str, dict[str, Any]] = field(default_factory=dict)
    hints: list[str] = field(default_factory=list)

    def set(self, name: str, value: Any, comment: str) -> None:
        """Set a parameter by its dotted name, with the comment beside it in the file."""
        self.values[name], self.comments[name] = value, comment


def propose(states: Sequence[RadarState], disorder_s: float) -> Proposal | None:
    """Return a tracker's parameters for the radars that sent reports; None without any.

    `disorder_s` is the largest difference between the newest stamp and that of a later cloud.
    """
    active = sorted(
        (s for s in states if s.reports and (s.plots or not s.positions)),
        key=lambda s: s.plots,
        reverse=True,
    )
    if not active:
        return None
    profile = from_arguments.load(resources.profile(PROFILE)[0])
    proposed = Proposal({k: v for k, v in profile.items() if not k.startswith(PROFILE_RADAR)})
    profiled = {
        name.removeprefix(PROFILE_RADAR): value
        for name, value in profile.items()
        if name.startswith(PROFILE_RADAR) and not name.endswith((".position", ".yaw_deg"))
    }
    for state in active:
        for name, value in profiled.items():
            proposed.values[f"{state.settings.name}.{name}"] = value
        _set_layout(proposed, state)
        _set_ranges(proposed, state, profiled)
    together = _place_radars(proposed, active)
    proposed.values["sensors"] = [state.settings.name for state in together]
    _set_times(proposed, together)
    # Clouds that are out of order by more than this, seconds, indicate a wrong clock.
    if disorder_s > 60.0:
        proposed.hints.append(
            f"a cloud is stamped {disorder_s:.0f} s before one that arrived earlier: the clock of "
            "a radar is wrong; reorder_s is left at its default"
        )
    elif len(together) > 1 and disorder_s:
        comment = "largest age of a cloud relative to the newest stamp at its arrival"
        proposed.set("reorder_s", math.ceil(10.0 * disorder_s) / 10.0, comment)
    for radar in (state.settings.name for state in active if state not in together):
        own = [name for name in proposed.values if name.startswith(f"{radar}.")]
        proposed.untracked[radar] = {name: proposed.values.pop(name) for name in own}
    return proposed


def measure(proposed: Proposal, states: Sequence[RadarState], bag: Path) -> None:
    """Set noise, clutter, detection and transponders from the radars' plots in a bag."""
    config = from_arguments.config_of(proposed.values)
    recorded = recorded_plots.read(BagReader(bag), config)
    near = {s.settings.name for s in states if 0.0 < s.statistics.farthest <= SURFACE_RANGE}
    found: dict[str, Findings] = {}
    for radar, plots in recorded.plots.items():
        try:
            own = None if plots is None else findings(plots)
        except TuningError:
            own = None
        # Two or three aircraft may all be unusual, and 200 plots show the noise within 5 %.
        min_tracks, min_plots = 4, 200
        if own is None or own.tracks < min_tracks or own.noise.plots < min_plots:
            proposed.hints.append(
                f"{radar}: its noise cannot be estimated from {len(plots or ())} plots in "
                f"{0 if own is None else own.tracks} tracks; that of the profile {PROFILE} is used"
            )
            if radar in near:
                proposed.hints.append(
                    f"{radar} sees less than {SURFACE_RANGE / 1e3:.0f} km: noise, detections, "
                    f"clutter and motions of the profile {PROFILE} are for a long-range radar and "
                    "may not fit; record longer"
                )
            continue
        found[radar] = own
        for row in proposal.rows(own, config.values, radar):
            if row.name in (*ESTIMATED, *OVER_RANGE) and row.proposed:
                proposed.set(f"{radar}.{row.name}", row.value, f"measured: {row.source}")
            elif row.name == "learn" and isinstance(row.value, list):
                # The decrease of the detection probability with range is assumed.
                proposed.values[f"{radar}.learn"] = [*row.value, "detection"]
        if math.isfinite(own.detection.value):
            _set_detection_probability(proposed, radar, own.detection.value)
    if found and found.keys() <= near:
        # Ships, vehicles and taxiing aircraft are slower than aircraft in flight, and turn slower.
        measured = unspecified(found)
        for name in OF_TARGETS:
            proposed.set(name, measured[name], "measured: the radar sees less than 20 km")
    together = [state for state in states if state.settings.name in proposed.values["sensors"]]
    false = {radar: own.false_share for radar, own in found.items()}
    _set_equipped_probability(proposed, together, false, config.values["equipped_probability"])


def _set_detection_probability(proposed: Proposal, radar: str, measured: float) -> None:
    """Set detection probabilities to learn from, which fall with range from a measured mean."""
    # A constant one would be too high at long ranges, where misses are correlated, and lose tracks.
    least, most = PROBABILITIES
    far = proposed.values[f"{radar}.max_range"]
    near = min(max(measured, least), most)
    table = [round(near, 3), round(max(near - PROBABILITY_SLOPE * far, least), 3)]
    name = f"{radar}.detection_probability"
    origin = f"measured mean: {measured:.3f}; its decrease with range is assumed"
    proposed.set(name, table, origin)
    proposed.set(f"{name}_range", [0.0, far], "up to max_range")


def write(path: Path, head: str, proposed: Proposal) -> None:
    """Write a parameter file; `ConfigError` if a tracker would refuse it."""
    from_arguments.config_of(proposed.values)
    yaml_files.write(path, head, proposed.values, proposed.comments)
    with path.open("a", encoding="utf-8") as stream:
        for name, values in proposed.untracked.items():
            stream.write(
                f"    # {name} cannot be placed relative to the others; its section would be\n"
            )
            lines = yaml_files.lines("", values, proposed.comments)
            stream.writelines(f"    # {line[4:]}\n" for line in lines if line.startswith("    "))


def _set_layout(proposed: Proposal, state: RadarState) -> None:
    radar, seen = state.settings.name, state.statistics
    proposed.values |= {
        f"{radar}.topic": names.detections(radar),
        f"{radar}.frame": radar,
        f"{radar}.units.azimuth_convention": "enu_ccw",
    }
    # Quantities with the names of their columns, and the numbers of plots that have them.
    known = {"height": ("height", seen.heights), "code": ("code", seen.codes)}
    known |= {"address": ("address", seen.addresses)}
    known |= {"detection_type": ("kind", seen.detection_types)}
    for quantity, (column, count) in known.items():
        if count:
            origin = f"in {count} of {state.plots} plots"
            proposed.set(f"{radar}.fields.{quantity}", column, origin)
    assembler = state.assembler
    by_sector = assembler.by_sector > assembler.by_time
    revolution_s = round(assembler.longest_revolution_s, 4)
    if by_sector:
        proposed.values[f"{radar}.fields.sector"] = "sector"
        changed = "; it has changed, and this is the longest" if len(assembler.parts) > 1 else ""
        origin = f"mean of its revolutions, from its sector crossings{changed}"
    elif assembler.finder.revolution_s:
        origin = "mean of its revolutions, from azimuths and times of its plots"
    elif revolution_s:
        origin = "as the radar reports"
    else:
        origin = "the tracker estimates it"
    proposed.set(f"{radar}.rotation_s", revolution_s, origin)
    sectors = assembler.sectors if by_sector else 0
    kind = "clouds are sectors" if by_sector else "clouds are slices of time"
    proposed.set(f"{radar}.sectors", sectors, kind)


def _set_ranges(proposed: Proposal, state: RadarState, own: dict[str, Any]) -> None:
    """Set a radar's ranges, and scale the profile's tables with them."""
    radar, seen = state.settings.name, state.statistics
    if not state.plots or not seen.farthest:
        return
    reach = seen.farthest * MAX_RANGE_FACTOR
    digit = 10.0 ** (math.floor(math.log10(reach)) - 1)
    most = math.ceil(reach / digit) * digit
    scale = most / own["max_range"]
    proposed.set(f"{radar}.max_range", most, f"its farthest plot is at {seen.farthest:.0f} m")
    proposed.set(f"{radar}.clutter_max_range", most, "as max_range")
    name = "detection_probability_range"
    scaled = [round(scale * distance) * 1.0 for distance in own[name]]
    proposed.set(f"{radar}.{name}", scaled, "assumed: the profile's, scaled to max_range")
    least = min(own["min_range"], float(math.floor(seen.nearest * MIN_RANGE_FACTOR)))
    origin = "the profile's value; " if least == own["min_range"] else ""
    proposed.set(
        f"{radar}.min_range", least, f"{origin}its nearest plot is at {seen.nearest:.0f} m"
    )


def _place_radars(proposed: Proposal, active: Sequence[RadarState]) -> list[RadarState]:
    """Set the radars' places on the earth; return the radars that can be tracked together."""
    sites = [(state, state.site) for state in active if state.site]
    if not sites:
        _leave_place_open(proposed, active[0])
        together = [active[0]]
    else:
        first, (latitude, longitude, _) = sites[0]
        origin = [latitude, longitude, 0.0]
        proposed.set("world_origin", origin, f"position of {first.settings.name}, at sea level")
        plane = SystemPlane(origin)
        together = []
        for state, site in sites:
            source = "as configured" if state.settings.site else "by the radar itself (I034/120)"
            proposed.set(f"{state.settings.name}.geodetic", list(site), source)
            if np.hypot(*plane.to_plane(*site[:2])) <= MAX_SITE_DISTANCE:
                together.append(state)
    reference = together[0].settings.name
    tracked = ", ".join(state.settings.name for state in together)
    proposed.hints += [
        f"{left}: not tracked, because its position is unknown or too far from that of "
        f"{reference}; tracked: {tracked}. Set {left}.geodetic"
        for left in (state.settings.name for state in active if state not in together)
    ]
    return together


def _leave_place_open(proposed: Proposal, state: RadarState) -> None:
    """Set the place of a radar without a known one."""
    # Place of a radar without a known one: the height alone, above an earth of the right curvature.
    unknown_place = (0.0,)
    radar = state.settings.name
    if state.statistics.farthest <= SURFACE_RANGE:
        proposed.comments[radar] = "its position is unknown; within its range the earth is flat"
        return
    origin = "a height alone: its position is unknown"
    proposed.set("world_origin", list(unknown_place), f"{origin}; no latitudes and longitudes")
    proposed.set(f"{radar}.geodetic", list(unknown_place), origin)
    proposed.hints.append(
        f"the position of {radar} is unknown: shapes and distances are right on the round earth, "
        f"but there are no latitudes and longitudes; set {radar}.geodetic and world_origin"
    )


def add_receivers(proposed: Proposal, states: Sequence[RadarState]) -> None:
    """Add the sources of positions beside the radars, if the place of these is known."""
    # Identity spaces of the sources of positions, and what their reports are.
    receivers = {
        ADS_B: ("icao", "positions of ADS-B (CAT021)"),
        MULTILATERATION: ("icao", "positions by multilateration (CAT010, CAT020)"),
        TRACKS: ("number", "tracks of another centre (CAT062), never used as plots"),
    }
    sources = [state for state in states if state.positions]
    if not sources or len(proposed.values.get("world_origin", ())) != 3:
        return
    for state in sources:
        name = state.settings.name
        identity, what = receivers[state.source]
        proposed.set(f"{name}.kind", "reports", what)
        proposed.set(f"{name}.identity", identity, "of addresses without a space")
        # Standard deviation of the place of an aircraft's antenna, metres.
        proposed.set(f"{name}.offset_std", 5.0, "of aircraft")
        proposed.values["sensors"] = [*proposed.values["sensors"], name]


def _set_times(proposed: Proposal, together: Sequence[RadarState]) -> None:
    """Set the times that depend on the longest revolution."""
    revolution_s = max(round(state.assembler.longest_revolution_s, 4) for state in together)
    if revolution_s:
        proposed.set("interval_s", revolution_s, "the longest revolution")
        proposed.set("estimates_period_s", revolution_s, "the longest revolution")
        proposed.set("lag_s", round(5.0 * revolution_s, 4), "five of the longest revolutions")


def _set_equipped_probability(
    proposed: Proposal, states: Sequence[RadarState], false: Mapping[str, float], default: float
) -> None:
    """Set the share of aircraft with a transponder from the plots of radars that report replies.

    `false` has the share of false plots by radar. Without that of every radar the result is a lower
    bound, and not below the default.
    """
    replied = [state for state in states if state.statistics.identified]
    if not replied:
        return
    identified = sum(state.statistics.identified for state in replied)
    aircraft = sum(state.plots * (1.0 - false.get(state.settings.name, 0.0)) for state in replied)
    share = round(identified / max(REPLY_PROBABILITY * aircraft, 1.0), 2)
    known = all(state.settings.name in false for state in replied)
    # Upper bound of `equipped_probability`.
    value = min(max(share, 0.01 if known else default), 0.99)
    plots = sum(state.plots for state in replied)
    clutter = f"{aircraft:.0f} are of aircraft" if known else "how many are clutter is unknown"
    origin = f"{identified} of {plots} plots have a code or an address, {clutter}"
    proposed.set("equipped_probability", value, origin)
