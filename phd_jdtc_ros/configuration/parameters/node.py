"""The parameters of a live tracker that are the node's own, and those that nodes have in common."""

from __future__ import annotations

from dataclasses import dataclass

from ..schema import parameter, table
from . import replaced


@dataclass(frozen=True)
class Managed:
    """The parameter of every managed node."""

    autostart: bool = parameter(True, "Configure and activate the node at the start.")


@dataclass(frozen=True)
class Receiving:
    """Common parameters of the nodes that receive from the network."""

    max_clock_offset_s: float = parameter(
        10.0,
        "Difference between the times of a source and those of receipt, s, above which its clock "
        "counts as wrong: the times of a radar are then shifted by the difference, and a report "
        "has the time of its receipt.",
        (0.5, 86400.0),
    )
    interface: str = parameter(
        "",
        "Address of the network interface for multicast groups, in and out; empty for the "
        "system's choice.",
    )
    replayed: bool = parameter(
        False,
        "Whether the input is a replayed recording, whose times of receipt are ignored: times are "
        "then those in it, and the first day of ASTERIX is 1970-01-01, as for a file.",
    )


@dataclass(frozen=True)
class Node(Managed):
    """The parameters of the live node only."""

    max_wait_s: float = parameter(
        0.0,
        "Longest time for which a scan waits for missing radars, s by the wall clock; 0 to wait "
        "for a later stamp.",
        (0.0, 3600.0),
    )
    outputs: list[str] = parameter(
        ["detections", "frames", "markers", "curves"],
        "Optional outputs; the tracker's page lists their topics, and the page of outputs what is "
        "sent by UDP and TCP. Latitudes and longitudes need world_origin, and only markers can "
        "change while the tracker is configured.",
        element=str,
        mutable=True,
        former=replaced.outputs,
    )
    destinations: list[str] = parameter(
        ["nmea+udp://127.0.0.1:10110", "cot+udp://127.0.0.1:4242", "signalk+udp://127.0.0.1:8375"],
        "Where ttm, ttm_relative and tll in outputs (nmea), cot, signalk and sapient are sent: "
        "FORMAT+udp:// or FORMAT+tcp:// with the HOST:PORT to send to, or FORMAT+listen:// with "
        "that at which TCP clients connect; sapient not by UDP.",
        element=str,
    )
    cot_types: list[str] = parameter(
        [],
        "Types of the classes in Cursor on Target, in their order, such as a-u-S for vessels. "
        "Empty for a-u-G, or a-u-A for a target with a code or an address.",
        element=str,
        repeats=True,
    )
    checkpoint_path: str = parameter(
        "",
        "File in which the tracker's state is stored, for a warm restart; empty for none.",
        name="checkpoint.path",
    )
    checkpoint_every: int = parameter(
        1,
        "Number of scans between checkpoints; 0 for checkpoints on request only.",
        (0, 10**6),
        name="checkpoint.every",
    )


NAMES = frozenset(parameter.name for parameter in table(Node))
