"""Latency from a radar's ASTERIX to tracks in ASTERIX, over UDP and DDS, in real time.

The bridge and the tracker are processes of their own. The first revolutions are sent as fast as
they are answered, until all aircraft are tracked. After them each sector is sent when the antenna
has passed its end, and its tracks are awaited.
"""

from __future__ import annotations

import contextlib
import math
import select
import socket
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from phd_jdtc_ros import resources
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.messages import DAY, NONE, PRIMARY, Plot
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports
from phd_jdtc_ros.transport import sockets

from .. import traffic
from ..timing import percentiles
from . import live, messages

AIRCRAFT = 100
REVOLUTIONS, QUICK_REVOLUTIONS = 10, 2
# A datagram that is lost on a busy machine, where UDP does not repeat it, costs one attempt.
ATTEMPTS = 3
RADAR, NUMBER = "approach", 0x0102
LOOPBACK = "127.0.0.1"
# The bridge's clouds have azimuths from east, and a field with the sector's number.
CHANGES: dict[str, Any] = {
    **traffic.AT_EVERY_SECTOR,
    "engine": "gaussian",
    "approach.units.azimuth_convention": "enu_ccw",
    "approach.fields.sector": "sector",
}
# The time of tracks is the middle of a sector or, before the rotation is known, its end; tolerance
# as a part of a sector.
SAME_PART = 0.25
CAT062, CAT065 = 62, 65


def measure(quick: bool) -> dict[str, Any]:
    """Return the latency of plots, seconds: from the antenna's passing to the receipt of tracks."""
    messages.environment()
    revolutions = QUICK_REVOLUTIONS if quick else REVOLUTIONS
    config = traffic.configuration(CHANGES)
    new_engine(config)  # Compiles what no earlier run has stored, which takes longer than a start
    scene = traffic.scene(traffic.SETTLING + revolutions, config, 0, AIRCRAFT)
    reports = simulate_reports(scene, config.radars, seed=0)
    found: dict[str, Any] = {}
    for _ in range(ATTEMPTS):
        found = _attempt(reports, config.radars[0].rotation_s)
        if "latency_s" in found:
            break
    return found


def _attempt(reports: Sequence[SimulatedReport], rotation_s: float) -> dict[str, Any]:
    """Return the figures of one run of both nodes, or the reason why there are none."""
    settling = traffic.SETTLING * traffic.SECTORS
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        directory = Path(name)
        site = stack.enter_context(contextlib.closing(_Site(reports, rotation_s)))
        log = directory / "bridge.log"
        stack.enter_context(live.node("tracker", directory / "tracker.log", *_tracker(directory)))
        stack.enter_context(live.node("asterix_bridge", log, *_bridge(site)))
        if not _says(log, live.START_S, f"receiving {site.radar}", f"{RADAR}: 1 subscribers"):
            return {"value": None, "reason": f"the nodes do not meet: {log.read_text()[-500:]}"}
        for report in reports[:settling]:
            if not site.answered(report, live.START_S):
                said = log.read_text()[-500:]
                return {"value": None, "reason": f"no tracks of the first revolutions: {said}"}
        return site.in_real_time(reports[settling:])


def _says(log: Path, timeout_s: float, *texts: str) -> bool:
    """Wait until a log has all texts; return whether it has."""
    end_s = time.monotonic() + timeout_s
    while not all(text in log.read_text() for text in texts):
        if time.monotonic() > end_s:
            return False
        time.sleep(0.1)
    return True


def _tracker(directory: Path) -> list[str]:
    """Return the arguments of a tracker of the bridge's clouds, received reliably."""
    values = sections.read(resources.find(traffic.PROFILE)).values(traffic.TRACKER)
    qos = {f"qos_overrides./{RADAR}/detections.subscription.reliability": "reliable"}
    file = directory / "tracker.yaml"
    document = {traffic.TRACKER: {"ros__parameters": {**values, **CHANGES, **qos}}}
    file.write_text(yaml.safe_dump(document))
    return ["--ros-args", "--params-file", str(file)]


def _bridge(site: _Site) -> list[str]:
    """Return the arguments of a bridge between a site and the tracker."""
    given = {
        "inputs": f"['{site.radar}']",
        "output": f"'{site.display}'",
        "output_period_s": "0.0",
        "radars": f"[{RADAR}]",
        f"{RADAR}.source": f"[{NUMBER >> 8}, {NUMBER & 255}]",
        "sectors": traffic.SECTORS,
        # Plots are sent before the crossing of their sector.
        "hold_sectors": 0,
        # The first revolutions are sent in haste.
        "max_clock_offset_s": 86400.0,
        "world_origin": "[52.0, 4.5, 0.0]",
    }
    return ["--ros-args", *(word for name in given for word in ("-p", f"{name}:={given[name]}"))]


def _free() -> sockets.Address:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sockets.Address(LOOPBACK, sock.getsockname()[1])


class _Site:
    """A radar that sends a scene, and a display that receives tracks."""

    def __init__(self, reports: Sequence[SimulatedReport], rotation_s: float) -> None:
        self.radar, self.display = _free(), _free()
        self._out = sockets.sender(self.radar, "")
        self._in = sockets.receiving_socket(self.display, "")
        self._rotation_s = rotation_s
        self._sector_s = rotation_s / traffic.SECTORS
        # Times of the scene to times of now, so that no day is guessed.
        self._shift_ns = time.time_ns() - reports[0].stamp_ns
        # When tracks of a time were received first, and how many: by the time's ticks.
        self._received: dict[float, tuple[float, int]] = {}
        self._tracks = 0

    def close(self) -> None:
        self._out.close()
        self._in.close()

    def send(self, report: SimulatedReport) -> None:
        """Send a sector's plots and its crossing."""
        stamp_ns = report.stamp_ns + self._shift_ns
        found = report.detections
        own_s = np.zeros(len(found)) if found.time_s is None else found.time_s
        plots = [
            (stamp_ns + round(time_s * 1e9), _plot(distance, azimuth))
            for time_s, (distance, azimuth) in zip(own_s, found.measurement, strict=True)
        ]
        end = 0.0 if found.coverage is None else 0.5 * math.pi - found.coverage.start
        crossing = plots_out.service_block(NUMBER, stamp_ns, end, self._rotation_s)
        for block in (*plots_out.plot_blocks(plots), crossing):
            with contextlib.suppress(ConnectionRefusedError):  # The bridge is not there yet
                self._out.send(block)

    def answered(self, report: SimulatedReport, timeout_s: float) -> bool:
        """Send a sector and return whether tracks came; the first one again until they do.

        The bridge needs the first sector to know the antenna's position.
        """
        first, end = not self._received, time.monotonic() + timeout_s
        self.send(report)
        while first and time.monotonic() < end:
            self.receive(0.5)
            if self._received:
                return True
            # Another revolution, so that the tracker takes it for the next one.
            self._shift_ns += round(self._rotation_s * 1e9)
            self.send(report)
        return self.wait_for(report, timeout_s)

    def wait_for(self, report: SimulatedReport, timeout_s: float) -> bool:
        """Wait for the tracks of a sector."""
        end = time.monotonic() + timeout_s
        while self.reply_to(report) is None:
            if time.monotonic() > end:
                return False
            self.receive(0.05)
        return True

    def reply_to(self, report: SimulatedReport) -> tuple[float, int] | None:
        """Return when the tracks of a sector were received, and how many; None if they were not."""
        end_s = (report.stamp_ns + self._shift_ns) * 1e-9 % 86_400
        for time_s, reply in self._received.items():
            if -SAME_PART < (end_s - time_s) / self._sector_s < 1.0 - SAME_PART:
                return reply
        return None

    def receive(self, timeout_s: float) -> None:
        """Take what comes within a time."""
        end = time.monotonic() + timeout_s
        while (left := end - time.monotonic()) > 0.0:
            if not select.select([self._in], [], [], left)[0]:
                return
            data = self._in.recv(65_535)
            now_s = time.monotonic()
            if data[0] == CAT062:
                self._tracks += 1
            elif data[0] == CAT065:
                # Selection, SAC and SIC, kind, service, then the time.
                ticks = int.from_bytes(data[8:11], "big")
                self._received[ticks / 128.0] = now_s, self._tracks
                self._tracks = 0
                return

    def in_real_time(self, reports: Sequence[SimulatedReport]) -> dict[str, Any]:
        """Send every sector when the antenna has passed it, and return the figures."""
        self._received.clear()
        begin_s = time.monotonic() + 0.5 - 1e-9 * reports[0].stamp_ns
        for report in reports:
            due_s = begin_s + 1e-9 * report.stamp_ns
            while (left := due_s - time.monotonic()) > 0.0:
                self.receive(left)
            self.send(report)
        self.wait_for(reports[-1], live.REPLY_S)
        late: list[float] = []
        lost = 0
        for report in reports:
            reply = self.reply_to(report)
            if reply is None:
                lost += 1
            elif report.detections.time_s is not None:
                passed = begin_s + 1e-9 * report.stamp_ns + report.detections.time_s
                late += list(reply[0] - passed)
        if lost:
            return {"value": None, "reason": f"{lost} of {len(reports)} sectors had no tracks"}
        return {
            "aircraft": AIRCRAFT,
            "sectors": len(reports),
            "plots": len(late),
            "latency_s": percentiles(late),
        }


def _plot(distance: float, azimuth: float) -> Plot:
    turned = 0.5 * math.pi - float(azimuth)
    return Plot(NUMBER, NONE, DAY, float(distance), turned, detection_type=PRIMARY)
