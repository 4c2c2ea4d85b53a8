"""A receiver of ships' own reports that dies, and one that hears 500 ships, beside a radar."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from msg_adapters.incoming import self_reports
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.types import Detections, Estimates, SelfReports
from phd_jdtc_ros.core.types.reports import MMSI
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.report_bridge import cloud
from phd_jdtc_ros.transport.network import Datagram

from ..harness.figures import Found, measures
from ..hostile_input.bad_receivers import BEGIN_NS, new_stream
from ..hostile_input.bad_receivers import report as sentence

NS, START_NS, TURN_S, FIRST = 10**9, 10**15, 2.5, 211_000_000
SPEED, APART = 6.0, 900.0
PARAMETERS = {
    "sensors": ["radar", "ais"],
    "interval_s": TURN_S,
    "accuracy": "fast",
    "lag": 0,
    "max_gap_scans": 20.0,
    "amplitude": "none",
    "classes": ["ship"],
    "motions": ["cv"],
    "cv.noise_density": 0.02,
    "ship.motions": ["cv"],
    "ship.mode_transition": [1.0],
    "ship.survival_probability": 0.9999,
    "births": [],
    "detection_births.rates": [5.0],
    "detection_births.std": [5.0],
    "radar.range_std": 10.0,
    "radar.azimuth_std_deg": 0.05,
    "radar.max_range": 40_000.0,
    "radar.detection_probability": 0.95,
    "radar.clutter_rate": 1.0,
    "radar.clutter_max_range": 40_000.0,
    "radar.fields.amplitude": "",
    "radar.learn": [],
    "ais.kind": "reports",
    "ais.obliged": ["ship"],
}


def _ships(count: int) -> FloatArray:
    """Return places of ships in a square, metres, (N, 2); all go east."""
    side = int(np.ceil(np.sqrt(count)))
    grid = np.stack(np.divmod(np.arange(count), side), axis=1)
    return APART * (grid - 0.5 * side) + 0.25 * APART


def _turns(ships: FloatArray, turns: int, every_s: float, until_s: float) -> Iterator[Estimates]:
    """Yield the estimates of each revolution; reports end at a time."""
    rng, pipeline = np.random.default_rng(2), new_pipeline(resolve(PARAMETERS))
    phase = rng.uniform(0.0, every_s, len(ships))
    for turn in range(1, turns + 1):
        now_s = turn * TURN_S
        count = np.floor((now_s - phase) / every_s) - np.floor((now_s - TURN_S - phase) / every_s)
        row = np.repeat(np.arange(len(ships)), count.astype(int))
        since_s = rng.uniform(0.0, TURN_S, len(row))
        if len(row) and now_s <= until_s:
            told = ships[row] + (now_s - since_s)[:, None] * [SPEED, 0.0]
            reports = SelfReports.of(
                START_NS + ((now_s - since_s) * NS).astype(np.int64),
                told + 8.0 * rng.standard_normal(told.shape),
                velocity=np.tile([SPEED, 0.0], (len(row), 1)),
                address=FIRST + row,
                space=np.full(len(row), MMSI),
            )
            pipeline.add_reports(0, reports)
        x, y = (ships + now_s * np.array([SPEED, 0.0])).T
        plots = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)
        plots = plots + rng.standard_normal(plots.shape) * [10.0, np.radians(0.05)]
        events = pipeline.add(0, START_NS + round(now_s * NS), Detections(plots, None))
        if isinstance(events, Rejection):
            raise ValueError(f"a revolution was rejected: {events.value}")
        for event in events:
            if isinstance(event, Stepped):
                yield from event.step.filtered


@measures("receiver of AIS dies", "none of its 16 ships is called dark in ten minutes")
def measure_dead_receiver(minutes: float = 10.0) -> Found:
    """Let a receiver die after two minutes, with ships that go on."""
    turns, highest = int((2.0 + minutes) * 60.0 / TURN_S), 0.0
    for estimates in _turns(_ships(16), turns, 10.0, 120.0):
        told = estimates.reports
        if told is not None and len(told.dark):
            highest = max(highest, float(told.dark.max()))
    return f"P(dark) at most {highest:.3f}", highest < 0.5, {"dark": highest}


@measures("500 ships with AIS", "2,000 reports a second and 500 targets on one core")
def measure_load(turns: int = 12) -> Found:
    """Count the processor time of 500 ships that report four times a second."""
    begin_s, found = 0.0, None
    for index, estimates in enumerate(_turns(_ships(500), turns, 0.25, 1e9)):
        found = estimates
        if index == turns // 2 - 1:  # All ships are known, and all functions compiled
            begin_s = time.process_time()
    used = (time.process_time() - begin_s) / ((turns - turns // 2) * TURN_S)
    told = None if found is None else found.reports
    tracks = 0 if told is None else int(((told.owned > 0.99) & (told.alone == 0)).sum())
    text = f"{used:.2f} s of CPU a second, {tracks} radar tracks with their sources"
    return text, used < 1.0 and tracks >= 500, {"cpu": used, "tracks": tracks}


@measures("2,000 ships through the bridge", "2,000 reports a second on half a core")
def measure_bridge(seconds: int = 5) -> Found:
    """Count the processor time of sentences from datagrams to what the tracker takes."""
    config = from_arguments.config_of(PARAMETERS | {"world_origin": [54.0, 10.0, 0.0]})
    own = config.receivers[0]
    stream, taken, used_s = new_stream(), 0, 0.0
    for tick in range(4 * seconds):
        received_ns = BEGIN_NS + tick * NS // 4
        pieces = [
            sentence(FIRST + ship, received_ns // NS % 60, 54.0 + 1e-3 * ship + 1e-6 * tick)
            for ship in range(500 * (tick % 4), 500 * (tick % 4) + 500)
        ]
        begin_s = time.process_time()
        for piece in pieces:
            for found in stream.feed(Datagram(piece, received_ns)):
                if found is not None:
                    told = self_reports.from_msg(cloud(found[1], "ais"), own)
                    taken += len(told.reports)
        used_s += time.process_time() - begin_s
    each_s = used_s / max(taken, 1)
    text = f"{2000 * each_s:.2f} s of CPU for 2,000 reports, {1.0 / each_s:,.0f} a second"
    return text, taken > 1500 * seconds and 2000 * each_s < 0.5, {"cpu": 2000 * each_s}
