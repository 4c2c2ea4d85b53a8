"""Programs that are connected to the tracker by TCP and do not read what it sends."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import ExitStack

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import LIGHT, Rig, options

STALLED = 10
# Largest number of scans until the last one has been disconnected; and scans before, as a measure.
SCANS, USUAL = 12_000, 200
# Largest delay of an answer that a receiver may cause, and memory for each of them.
MOST_MS, MOST_MB = 20.0, 8.0


class _Reader:
    """A client that reads, and counts what it has got."""

    def __init__(self, where: tuple[str, int]) -> None:
        self._socket = socket.create_connection(where)
        self.events = 0
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while found := self._socket.recv(2**16):
            self.events += found.count(b"\n")


@measures(
    "receivers that do not read",
    f"all disconnected; answers at most {MOST_MS:g} ms later; at most +{MOST_MB:g} MB for each; "
    "one that reads gets everything",
)
def measure(stalled: int = STALLED, scans: int = SCANS) -> Found:
    """Connect clients that never read, and one that does, and track until those are cut off."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        where = free.getsockname()[:2]
    to = f"cot+listen://{where[0]}:{where[1]}"
    given = {"outputs": "[cot]", "world_origin": "[54.3, 10.2, 0.0]", "destinations": f"['{to}']"}
    with Rig() as rig, ExitStack() as clients:
        tracker, radars = rig.tracking(*LIGHT, *options(given))
        usual_ms = _answers(radars, 0, USUAL)
        before = tracker.status("VmHWM")
        for _ in range(stalled):
            client = clients.enter_context(socket.socket())
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.connect(where)
        reader, index, later_ms = _Reader(where), USUAL, np.zeros(0)
        radars.spin(1.0)
        begun = int(radars.values("outputs")[f"{to} sent"])
        while index < USUAL + scans:
            later_ms = np.append(later_ms, _answers(radars, index, USUAL))
            index += USUAL
            radars.spin(1.0)
            values = radars.values("outputs")
            if int(values[f"{to} stalled"]) == stalled:
                break
        growth_mb = (tracker.status("VmHWM") - before) / 1024.0
        missing = int(values[f"{to} sent"]) - begun - reader.events
    cut = int(values[f"{to} stalled"])
    delay_ms = float(np.percentile(later_ms, 99) - np.percentile(usual_ms, 99))
    text = (
        f"{cut} of {stalled} disconnected in {index - USUAL} scans; 99 % of answers within "
        f"{delay_ms:+.1f} ms; memory +{growth_mb:.0f} MB; {missing} events missing to the reader"
    )
    reached = cut == stalled and delay_ms <= MOST_MS and growth_mb <= MOST_MB * stalled
    details = {"disconnected": cut, "delay_ms": delay_ms, "memory_mb": growth_mb}
    return text, reached and missing == 0, {**details, "missing": missing}


def _answers(radars: Radars, first: int, count: int) -> FloatArray:
    """Track scans, each after the answer to the one before; return the times of answers, ms."""
    found = []
    for index in range(first, first + count):
        begin = time.monotonic()
        radars.track(index)
        found.append(1e3 * (time.monotonic() - begin))
    return np.array(found)
