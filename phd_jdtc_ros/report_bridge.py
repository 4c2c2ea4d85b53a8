"""The report bridge's parameters, and what they describe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros.configuration.parameters.place_forms import PLACE
from phd_jdtc_ros.configuration.schema import ConfigError, check, parameter, shared, table
from phd_jdtc_ros.parameter_files.node_tables import Managed, Receiving
from phd_jdtc_ros.transponders.stream import WIDE, Batch, ReportStream, StreamSettings, columns
from phd_jdtc_ros.transport import sockets

# Time for which reports are collected to a cloud, seconds; the tracker needs none of them sooner.
PERIOD_S = 0.5


@dataclass(frozen=True)
class StreamParameters:
    """Parameters of the reports."""

    max_clock_offset_s: float = shared(Receiving, "max_clock_offset_s")
    geodetic: list[float] = parameter(
        [],
        "Latitude and longitude (degrees) and height (m) of the receiver, which aircraft on the "
        "ground need until they have been heard in the air (raw 1090 MHz only). Empty if unknown.",
        form=PLACE,
    )


@dataclass(frozen=True)
class NodeParameters(Managed):
    """Parameters of the node only."""

    inputs: list[str] = parameter(
        ["127.0.0.1:10110"],
        "Inputs: HOST:PORT of this machine or of a multicast group (UDP), tcp://HOST:PORT of a "
        "server, serial:PATH:BAUD of a serial line. The format is recognised.",
        element=str,
        # Largest number of inputs, each of which needs a socket.
        most=64,
    )
    interface: str = shared(Receiving, "interface")
    replayed: bool = shared(Receiving, "replayed")


OF_FILES = table(StreamParameters)
TABLE = (*OF_FILES, *table(NodeParameters))


def resolve(given: Mapping[str, Any], top: Any = OF_FILES) -> dict[str, Any]:
    """Return all parameters; `ConfigError` has all faults. `top` is `TABLE` for the node."""
    values, faults = check(top, given, {})
    if not faults:
        faults = [*_faults(values)]
    if faults:
        raise ConfigError(*faults)
    return values


def _faults(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for text in values.get("inputs", []):
        try:
            sockets.input_of(text)
        except ValueError as error:
            faults.append(f"inputs: {error}")
    return [*faults, *sockets.interface_faults(values.get("interface", ""))]


def stream(values: Mapping[str, Any], start_ns: int = 0) -> ReportStream:
    """Return the stream of reports that the parameters describe; see `StreamSettings`."""
    place = values["geodetic"]
    return ReportStream(
        StreamSettings(
            round(PERIOD_S * 1e9),
            round(values["max_clock_offset_s"] * 1e9),
            (place[0], place[1]) if place else None,
            start_ns,
        )
    )


def missing(error: ModuleNotFoundError) -> str:
    """Return the fault that the library of a format is not installed, or raise the error again."""
    what = {"pyais": "AIS", "rs1090": "raw 1090 MHz"}.get((error.name or "").split(".")[0])
    if what is None:
        raise error
    return f"{error.name} is not installed, which {what} needs: pip install {error.name}"


def cloud(batch: Batch, frame: str, ellipses: bool = False) -> PointCloud2:
    """Return the cloud of a batch; see `columns`."""
    return point_cloud.encode(batch.stamp_ns, frame, columns(batch, ellipses), WIDE)
