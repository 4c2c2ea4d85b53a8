"""A flood of large datagrams of tiny records, or of sentences of AIS, at the live bridges."""

from __future__ import annotations

import signal
import socket
import struct
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics

from ..harness.figures import Found, measures
from ..harness.radars import Radars
from ..harness.rig import Rig

SECONDS, ANSWER_S, STOP_S, MEMORY_MB = 5.0, 2.0, 2.0, 128.0
# The smallest record of a plot: radar, place, and nothing else.
RECORD = b"\x90\x01\x02\x10\x00\x20\x00"
BODY = RECORD * (60_000 // len(RECORD))
DATAGRAM = struct.pack(">BH", 48, len(BODY) + 3) + BODY
# Sentences of one ship, as many as a datagram holds.
SENTENCES = b"!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C\r\n" * 1300
LONGEST_S = 60.0


class _Flood:
    """Sends datagrams as fast as it can, in a thread, while the context lasts."""

    def __init__(self, port: int, datagram: bytes) -> None:
        self._stopped = threading.Event()
        self._port, self._datagram, self.sent = port, datagram, 0
        self._thread = threading.Thread(target=self._send, daemon=True)

    def __enter__(self) -> _Flood:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()

    def _send(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            while not self._stopped.is_set():
                try:
                    sock.sendto(self._datagram, ("127.0.0.1", self._port))
                    self.sent += 1
                except OSError:  # The receiver has ended
                    time.sleep(0.01)


GOAL = (
    f"{SECONDS:g} s of 60 kB at full speed: answers within {ANSWER_S:g} s, stops within "
    f"{STOP_S:g} s, {MEMORY_MB:g} MB more, drops counted"
)


@measures("flood of large datagrams", GOAL)
def measure() -> Found:
    """Flood the ASTERIX bridge while calling a service, and stop it during another flood."""
    return _flooded("asterix_bridge", DATAGRAM)


@measures("flood of sentences", GOAL)
def measure_sentences() -> Found:
    """Flood the report bridge in the same way."""
    return _flooded("report_bridge", SENTENCES)


def _flooded(name: str, datagram: bytes) -> Found:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with Rig() as rig:
        bridge = rig.start(name, "--ros-args", "-p", f"inputs:=['127.0.0.1:{port}']")
        if not bridge.said("receiving"):
            raise RuntimeError(bridge.why_not("receiving"))
        radars, lost = rig.radars, [0]
        radars.node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, lambda array: _note(array, name, lost), 100
        )
        _answer_s(radars, name)
        before_mb = bridge.status("VmRSS") / 1024.0
        answers, until_s = [], time.monotonic() + SECONDS
        with _Flood(port, datagram) as flood:
            while time.monotonic() < until_s and bridge.alive:
                answers.append(_answer_s(radars, name))
        answers.append(_answer_s(radars, name))
        counted = radars.spin_until(lambda: lost[0] > 0, 10.0)
        memory_mb = bridge.status("VmHWM") / 1024.0 - before_mb
        with _Flood(port, datagram):
            time.sleep(1.0)
            begin_s = time.monotonic()
            status = bridge.stop(signal.SIGINT)
            stop_s = time.monotonic() - begin_s
    text = (
        f"{flood.sent:,} datagrams: answers within {max(answers):.2f} s, stops in {stop_s:.2f} s "
        f"with status {status}, +{memory_mb:.0f} MB, {lost[0]:,} drops counted"
    )
    prompt = max(answers) <= ANSWER_S and stop_s <= STOP_S and status == 0
    reached = prompt and memory_mb <= MEMORY_MB and counted
    details = {"answer_s": max(answers), "stop_s": stop_s, "memory_mb": memory_mb, "lost": lost[0]}
    return text, reached, details


def _answer_s(radars: Radars, name: str) -> float:
    """Return how long the bridge takes to answer, seconds."""
    client = radars.node.create_client(GetParameters, f"/{name}/get_parameters")
    try:
        if not radars.spin_until(client.service_is_ready, LONGEST_S):
            return LONGEST_S
        begin_s = time.monotonic()
        future = client.call_async(GetParameters.Request(names=["inputs"]))
        radars.spin_until(future.done, LONGEST_S)
        return time.monotonic() - begin_s
    finally:
        radars.node.destroy_client(client)


def _note(array: DiagnosticArray, name: str, lost: list[int]) -> None:
    for status in array.status:
        if status.name == names.health("input", f"/{name}"):
            lost[0] = max(lost[0], int(diagnostics.values_of(status)["lost"]))
