"""The demo of an air traffic picture: ASTERIX in, ASTERIX out.

A recording is sent by UDP as radars would send it, bridged, tracked and scored live; sentences of
AIS beside it go through their bridge in the same way. The tracks that the bridge sends by UDP are
written to a file. All traffic stays on the loopback interface.
"""

from __future__ import annotations

import os
import random
import select
import socket
import sys
import threading
import time
from pathlib import Path

from msg_adapters.encoding import names
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.transport import sockets
from phd_jdtc_ros.transport.sockets import Address

from ..asterix.writing import bridge_parameters
from . import processes
from .processes import FINISH_S, PARAMETERS, RECORDING, Processes

# The recording beside a bag, and the tracks from the bridge.
SHIPPED, SENTENCES, TRACKS = "recording.ast", "recording.nmea", "tracks.ast"
BRIDGE, REPORTS, PLAYER = "asterix_bridge", "report_bridge", "asterix_player"
LOOPBACK = "127.0.0.1"
# Longest time for a datagram to arrive on the loopback interface, seconds.
LOOK_S = 0.5
STATUS_CATEGORY = 65
# Additional results of a demo with ASTERIX, relative to its output directory.
ARTEFACTS = (TRACKS, *(f"logs/{node}.log" for node in (BRIDGE, REPORTS, PLAYER)))


def recording(bag: Path, name: str = SHIPPED) -> Path | None:
    """Return the recording of ASTERIX, or another one, beside a bag; None without one."""
    path = (bag if bag.is_dir() else bag.parent) / name
    return path if path.is_file() else None


def run_nodes(bag: Path, config: TrackerConfig, out: Path, logs: Path, cutoff: float) -> bool:
    """Play the recording beside a bag through a bridge; see `processes.run`.

    The tracks are written to ``out / TRACKS``.
    """
    where, heard_at = input_address(), input_address()
    sentences = recording(bag, SENTENCES) if config.receivers else None

    def play(nodes: Processes) -> bool:
        connection = {
            "inputs": f"['{where}']",
            "interface": LOOPBACK,
            "output": f"'{tracks.address}'",
            "replayed": True,
        }
        nodes.start(BRIDGE, [], {**bridge_parameters(config), **connection})
        # The subscribers are the tracker and the evaluator, which records.
        ready = [f"{names.detections(radar.name)}: 2 subscribers" for radar in config.inputs]
        if not all(nodes.wait_for(BRIDGE, text) for text in ready):
            return False
        if sentences is not None:
            own = {"inputs": f"['{heard_at}']", "interface": LOOPBACK, "replayed": True}
            nodes.start(REPORTS, [], own)
            ready = [f"{each.topic}: 1 subscribers" for each in config.receivers]
            if not all(nodes.wait_for(REPORTS, text) for text in ready):
                return False
        sent = ["--recording", str(recording(bag)), "--send", str(where)]
        sent += ["--tracker", str(logs / PARAMETERS)]
        if sentences is not None:
            sent += ["--sentences", str(sentences), "--send-sentences", str(heard_at)]
        if not processes.replay(nodes, bag, config, sent, PLAYER, f"{__package__}.{PLAYER}"):
            return False
        outputs = BagReader(out / RECORDING).counts[names.estimates(FILTERED)]
        complete = tracks.wait_for(outputs)
        if not complete:
            print(f"demo: {tracks.outputs} of {outputs} outputs of tracks came", file=sys.stderr)
        return complete

    with TrackFile(out / TRACKS) as tracks:
        return processes.run(bag, config, out, logs, cutoff, play)


class TrackFile:
    """Receives a bridge's datagrams at `address` and writes them to a file, within the context."""

    def __init__(self, path: Path) -> None:
        self._socket = sockets.receiving_socket(Address(LOOPBACK, 0), "")
        self.address = Address(*self._socket.getsockname())
        self.outputs = 0  # Number of complete ones
        self._file = path.open("wb")
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._receive, name="tracks", daemon=True)

    def __enter__(self) -> TrackFile:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        self._socket.close()
        self._file.close()

    def wait_for(self, outputs: int) -> bool:
        """Wait for a number of complete outputs; return whether they came."""
        deadline = time.monotonic() + FINISH_S
        while self.outputs < outputs and time.monotonic() < deadline:
            time.sleep(0.05)
        return self.outputs >= outputs

    def _receive(self) -> None:
        while not self._stopped.is_set():
            if not select.select([self._socket], [], [], sockets.POLL_S)[0]:
                continue
            data = self._socket.recv(sockets.LARGEST)
            self._file.write(data)
            # An output ends with the data block of the tracker's own state.
            self.outputs += data[0] == STATUS_CATEGORY


def input_address() -> Address:
    """Return the radars' destination: a multicast group on the loopback interface, if possible.

    The group depends on the process, so that parallel demos do not interfere.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        port = int(sock.getsockname()[1])
    chosen = random.Random(os.getpid())
    group = Address(f"239.255.{chosen.randrange(256)}.{chosen.randrange(1, 255)}", port)
    return group if _loops(group) else Address(LOOPBACK, port)


def _loops(group: Address) -> bool:
    """Return whether datagrams to a group on the loopback interface arrive."""
    try:
        with (
            sockets.receiving_socket(group, LOOPBACK) as inp,
            sockets.sender(group, LOOPBACK) as out,
        ):
            out.send(b"?")
            return bool(select.select([inp], [], [], LOOK_S)[0])
    except OSError:
        return False
