"""The demo of an air traffic picture: ASTERIX in, ASTERIX out.

A recording is sent by UDP as radars would send it, bridged, tracked and scored live. The tracks
that the bridge sends by UDP are written into a file. All addresses are of the loopback interface.
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

from msg_adapters import names
from phd_jdtc_ros.asterix.transport import udp
from phd_jdtc_ros.asterix.transport.udp import Address
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.types import FILTERED

from ..asterix.writing import bridge_parameters
from .processes import FINISH_S, PARAMETERS, RECORDING, Processes, reporting, start_tracking

# The recording beside a bag, and what the bridge has sent.
SHIPPED, TRACKS = "recording.ast", "tracks.ast"
BRIDGE, PLAYER = "asterix_bridge", "asterix_player"
LOOPBACK = "127.0.0.1"
# How long a datagram may be under way on the loopback interface, seconds.
LOOK_S = 0.5
STATUS_CATEGORY = 65
# What a demo of a recording writes in addition, relative to its output directory.
ARTEFACTS = (TRACKS, *(f"logs/{node}.log" for node in (BRIDGE, PLAYER)))


def recording(bag: Path) -> Path | None:
    """Return the recording of ASTERIX beside a bag, None without one."""
    path = (bag if bag.is_dir() else bag.parent) / SHIPPED
    return path if path.is_file() else None


def run_nodes(bag: Path, config: TrackerConfig, out: Path, logs: Path, cutoff: float) -> bool:
    """Play the recording beside a bag through a bridge; return whether no process failed.

    Parameters are those of `demo.run_nodes`. The tracks are written into ``out / TRACKS``.
    """
    evaluator = reporting(bag, config, out, cutoff)
    where = input_address()
    with TrackFile(out / TRACKS) as tracks, Processes(logs) as nodes:
        if not start_tracking(nodes, config, logs, evaluator):
            return False
        sockets = {
            "inputs": f"['{where}']",
            "interface": LOOPBACK,
            "output": f"'{tracks.address}'",
            "replayed": True,
        }
        nodes.start(BRIDGE, [], {**bridge_parameters(config), **sockets})
        # The tracker, and the evaluator, which records.
        ready = [f"{radar.name}: 2 subscribers" for radar in config.inputs]
        if not all(nodes.wait_for(BRIDGE, text) for text in ready):
            return False
        words = [str(recording(bag)), "--bag", str(bag), "--send", str(where)]
        words += ["--interface", LOOPBACK, "--params-file", str(logs / PARAMETERS)]
        module = f"{__package__}.{PLAYER}"
        nodes.start(PLAYER, words, {}, shown=True, module=module)
        if not (nodes.wait(PLAYER) and nodes.wait("evaluator", FINISH_S)):
            return False
        outputs = BagReader(out / RECORDING).counts[names.estimates(FILTERED)]
        if not tracks.wait_for(outputs):
            print(f"demo: {tracks.outputs} of {outputs} outputs of tracks came", file=sys.stderr)
            return False
    return True


class TrackFile:
    """Receives what a bridge sends and writes it into a file, until the context ends.

    Attributes
    ----------
    address : Address
        Where to send to.
    outputs : int
        Number of outputs that are complete.
    """

    def __init__(self, path: Path) -> None:
        self._socket = udp.receiving_socket(Address(LOOPBACK, 0), "")
        self.address = Address(*self._socket.getsockname())
        self.outputs = 0
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
        """Wait until so many outputs are complete; return whether they are."""
        deadline = time.monotonic() + FINISH_S
        while self.outputs < outputs and time.monotonic() < deadline:
            time.sleep(0.05)
        return self.outputs >= outputs

    def _receive(self) -> None:
        while not self._stopped.is_set():
            if not select.select([self._socket], [], [], udp.POLL_S)[0]:
                continue
            data = self._socket.recv(udp.LARGEST)
            self._file.write(data)
            # The last data block of an output is that of the tracker's own state.
            self.outputs += data[0] == STATUS_CATEGORY


def input_address() -> Address:
    """Return where the radars send to: a group of the loopback interface, where there is any.

    The group is one of many, so that demos beside each other do not hear each other.
    """
    port = _free_port()
    # Not of the random numbers that anything else depends on.
    chosen = random.Random(os.getpid())
    group = Address(f"239.255.{chosen.randrange(256)}.{chosen.randrange(1, 255)}", port)
    return group if _loops(group) else Address(LOOPBACK, port)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return int(sock.getsockname()[1])


def _loops(group: Address) -> bool:
    """Return whether what is sent to a group of the loopback interface arrives."""
    try:
        with udp.receiving_socket(group, LOOPBACK) as heard, udp.sender(group, LOOPBACK) as sender:
            sender.send(b"?")
            return bool(select.select([heard], [], [], LOOK_S)[0])
    except OSError:
        return False
