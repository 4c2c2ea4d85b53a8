"""The reference scenario's scans as serialised clouds, whose stamps can be set."""

from __future__ import annotations

import struct
from dataclasses import replace
from functools import cache
from pathlib import Path

from msg_adapters.encoding import interfaces
from msg_adapters.incoming import detections
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.types import Detections, Scan, Truth
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.simulation.targets import TargetScript

ROOT = Path(__file__).parents[2]
BAG, CONFIG = ROOT / "bags" / "paper_scenario", ROOT / "config"
PROFILE = CONFIG / "surveillance.yaml"
SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
# The stamp's seconds and nanoseconds follow the four bytes of the encapsulation.
_STAMP = struct.Struct("<iI")
_STAMP_OFFSET = 4


def _radars() -> tuple[RadarModel, ...]:
    return polar_radars(resolve(from_arguments.scenario_parameters(None)).model.radars)


@cache
def _simulate() -> tuple[tuple[Truth, Scan], ...]:
    return tuple(simulate(paper_scenario(_radars()), 0))


def reference() -> tuple[Scan, ...]:
    """Return the scans of the reference scenario."""
    return tuple(scan for _, scan in _simulate())


def report(index: int, radar: int) -> Detections:
    """Return a radar's detections of a scan of the reference scenario."""
    return _of_radar(reference()[index], radar)


def _of_radar(scan: Scan, radar: int) -> Detections:
    found = scan.detections[radar]
    if found is None:
        raise ValueError(f"radar {radar} has no report of the scan at {scan.stamp_ns} ns")
    return found


def truth() -> tuple[Truth, ...]:
    """Return the truth at each scan of the reference scenario."""
    return tuple(truth for truth, _ in _simulate())


def often(count: int, factor: int) -> tuple[tuple[bytes, bytes], ...]:
    """Return both radars' clouds, with `factor` times the reference scenario's scan rate.

    The targets are slower, so that they exist all the time.
    """
    usual = paper_scenario(_radars())
    targets = tuple(
        replace(
            target,
            velocity=(0.2 * target.velocity[0], 0.2 * target.velocity[1]),
            first_scan=0,
            last_scan=count - 1,
        )
        for target in usual.targets
        if isinstance(target, TargetScript)
    )
    interval_s = usual.interval_s / factor
    scene = replace(usual, scans=count, targets=targets, interval_s=interval_s)
    return tuple(_clouds(scan, scan.stamp_ns) for _, scan in simulate(scene, 0))


def _clouds(scan: Scan, stamp_ns: int) -> tuple[bytes, bytes]:
    first, second = (
        bytes(interfaces.encode(detections.to_msg(_of_radar(scan, radar), stamp_ns, frame)))
        for radar, frame in enumerate(("radar_1", "radar_2"))
    )
    return first, second


@cache
def with_clutter(clutter_rate: float) -> tuple[tuple[bytes, bytes], ...]:
    """Return both radars' clouds of every scan, with this many false detections in each."""
    radars = tuple(replace(radar, clutter_rate=clutter_rate) for radar in _radars())
    run = simulate(paper_scenario(radars), 0)
    return tuple(_clouds(scan, stamp_of_scan(index)) for index, (_, scan) in enumerate(run))


def interval_ns() -> int:
    """Return the time between two scans of the reference scenario."""
    return round(resolve(from_arguments.scenario_parameters(None)).model.modes.interval_s * 1e9)


def stamp_of_scan(index: int) -> int:
    """Return the stamp of the scan with this index; the scenario repeats itself."""
    return START_NS + index * interval_ns()


@cache
def _templates() -> tuple[tuple[bytes, bytes], ...]:
    return tuple(_clouds(scan, START_NS) for scan in reference())


def cloud(index: int, radar: int, stamp_ns: int | None = None) -> bytes:
    """Return a radar's serialised cloud of a scan; the scenario repeats itself."""
    data = _templates()[index % len(_templates())][radar]
    stamp = stamp_of_scan(index) if stamp_ns is None else stamp_ns
    begin, end = _STAMP_OFFSET, _STAMP_OFFSET + _STAMP.size
    return data[:begin] + _STAMP.pack(*divmod(stamp, SECOND_NS)) + data[end:]
