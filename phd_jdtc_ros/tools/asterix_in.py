# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of ASTERIX to bags: clouds of each radar's sectors, and parameters for a tracker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msg_adapters import interfaces, names
from phd_jdtc_ros import resources
from phd_jdtc_ros.asterix import framing
from phd_jdtc_ros.asterix.assembly import SectorReport
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.framing import RecordingError
from phd_jdtc_ros.asterix.plot_stream import PlotStream, RadarState
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.writer import BagWriter, Topic
from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.nodes.asterix import clouds, settings
from phd_jdtc_ros.nodes.asterix.settings import Bridge
from phd_jdtc_ros.nodes.common import bag_parameters

from . import params_file

DEPTH = 50
# The profile of trackers of such radars, and the name of the radar in it.
PROFILE, PROFILE_RADAR = "air_traffic", "approach."


@dataclass
class Converted:
    """What became of a recording.

    Parameters
    ----------
    stream : PlotStream
    recording : Counter
        What was skipped of the file, by reason.
    clouds, plots : int
        Written.
    """

    stream: PlotStream
    recording: Counter[str] = field(default_factory=Counter)
    clouds: int = 0
    plots: int = 0

    def lines(self) -> Iterator[str]:
        """Yield what was read of each radar, and what was left out and why."""
        for state in self.stream.radars.values():
            found = {"plots": state.plots, "service messages": state.services}
            text = ", ".join(f"{count} {what}" for what, count in found.items())
            turn_s = state.assembler.observed_turn_s
            turn = f", a turn of {turn_s:.2f} s" if turn_s else ""
            yield f"{state.settings.name}: {text}, {state.reports} clouds{turn}{_of(state.counts)}"
            if state.counts["second_source"]:
                own = " and ".join(dict.fromkeys(state.sources.values()))
                yield (
                    f"{state.settings.name}: messages of two sources, {own} and "
                    f"{state.other_source}: those of the second are left out"
                )
            shift_s = self.stream.clock.shift_ns.get(_number(self.stream, state), 0) * 1e-9
            if shift_s:
                yield f"{state.settings.name}: its clock is {-shift_s:+.1f} s off, and was shifted"
        left_out = +(self.recording + self.stream.counts)
        yield f"left out: {_listed(left_out) or 'none'}"


def _number(stream: PlotStream, state: RadarState) -> int:
    return next(number for number, each in stream.radars.items() if each is state)


def _of(counts: Counter[str]) -> str:
    listed = _listed(counts)
    return f"; {listed}" if listed else ""


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()) if count)


def convert(
    path: Path, out: Path, bridge: Bridge, midnight_ns: int | None, ports: Iterable[int]
) -> Converted:
    """Write the clouds of a recording into a new bag, with parameters for a tracker beside it.

    Parameters
    ----------
    path, out : Path
    bridge : Bridge
    midnight_ns : int or None
        Begin of the recording's day; see `framing.datagrams`.
    ports : iterable of int
        Of captures: what was sent to other ports is left out; none for all.

    Raises
    ------
    BagError
        If the file is no recording of ASTERIX, or the bag cannot be written.
    """
    clock = StreamClock(midnight_ns or 0, bridge.values["max_clock_offset_s"])
    done = Converted(PlotStream(bridge.radars, bridge.others, clock))
    try:
        with framing.opened(path) as data:
            framing.kind_of(data)
            with BagWriter(out) as bag:
                known: set[str] = set()
                for state, report in _reports(data, done, midnight_ns, frozenset(ports)):
                    _write(bag, known, done, bridge, state, report)
    except RecordingError as error:
        raise BagError(f"{path}: {error}") from error
    values = tracker_parameters(done.stream)
    if values:
        bag_parameters.write(out / bag_parameters.NAME, resolve(values).values)
    return done


def _reports(
    data: Any, done: Converted, midnight_ns: int | None, ports: frozenset[int]
) -> Iterator[tuple[RadarState, SectorReport]]:
    """Yield the sectors of a recording in the order in which they are complete."""
    for received in framing.datagrams(data, midnight_ns, done.recording):
        port = framing.port_of(received)
        if ports and port is not None and port not in ports:
            done.recording["other_port"] += 1
            continue
        yield from done.stream.feed(*received)
    yield from done.stream.finish()


def _write(
    bag: BagWriter,
    known: set[str],
    done: Converted,
    bridge: Bridge,
    state: RadarState,
    report: SectorReport,
) -> None:
    name = state.settings.name
    topic = settings.topic_of(name)
    if topic not in known:
        bag.add_topic(Topic(topic, names.CLOUD, DEPTH))
        known.add(topic)
    message = clouds.cloud(report, name, state.settings.sectors, bridge.amplitudes(name))
    bag.write(topic, interfaces.encode(message), report.stamp_ns)
    done.clouds += 1
    done.plots += len(report.plots)


def tracker_parameters(stream: PlotStream) -> dict[str, Any]:
    """Return parameters of a tracker of the radars that were heard; none without any.

    They are those of the profile for such radars, with what the recording says of them. Where the
    radars are, no recording says.
    """
    heard = [state for state in stream.radars.values() if state.reports]
    if not heard:
        return {}
    profile = params_file.load(resources.profile(PROFILE)[0])
    own = {
        name.removeprefix(PROFILE_RADAR): value
        for name, value in profile.items()
        if name.startswith(PROFILE_RADAR)
    }
    values = {name: v for name, v in profile.items() if not name.startswith(PROFILE_RADAR)}
    values["radars"] = [state.settings.name for state in heard]
    for state in heard:
        for name, value in {**own, **_of_radar(state)}.items():
            values[f"{state.settings.name}.{name}"] = value
    turns = [turn_s for state in heard if (turn_s := state.assembler.observed_turn_s)]
    if turns:
        turn_s = round(max(turns), 2)
        values |= {"interval_s": turn_s, "estimates_period_s": turn_s, "lag_s": 5.0 * turn_s}
    return values


def _of_radar(state: RadarState) -> dict[str, Any]:
    """Return a radar's own parameters: the layout of its clouds and how it turns."""
    name = state.settings.name
    turn_s = round(state.assembler.observed_turn_s, 2)
    fields = ["range", "azimuth", "time", "height", "code", "address", "kind"]
    if turn_s:
        fields.append("sector")
    return {
        "topic": settings.topic_of(name),
        "frame": name,
        **{f"fields.{each}": each for each in fields},
        "fields.amplitude": "",
        "azimuth_convention": "enu_ccw",
        "rotation_s": turn_s,
        "sectors": state.settings.sectors if turn_s else 0,
    }
