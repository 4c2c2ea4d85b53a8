"""The timing of radars' messages on a network; the block ``sending`` of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from phd_jdtc_ros.configuration.schema import Parameter
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from .checked import values_by_radar

SENDING = (
    Parameter("sectors", 32, "Number of sectors per turn in which plots are sent.", 1, 1024),
    Parameter("plots", 10, "Largest number of plots in a data block.", 1, 100),
    Parameter("delay_s", 0.3, "Delay of plots after the end of their sector, s.", 0.0, 60.0),
    Parameter("services", True, "Whether north marks and sector crossings are sent."),
    Parameter("clock_ahead_s", 0.0, "Lead of the radar's clock over true time, s.", -86400, 86400),
)


@dataclass(frozen=True)
class Sending:
    """The timing of a radar's messages; see `SENDING`."""

    sectors: int = 32
    plots: int = 10
    delay_s: float = 0.3
    services: bool = True
    clock_ahead_s: float = 0.0


def of_radars(
    document: Mapping[str, object], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Sending, ...]:
    """Return the timing of each radar's messages in a document; add faults to `faults`."""
    every = values_by_radar(SENDING, document, "sending", radars, faults)
    return tuple(Sending(**(values or {})) for values in every)
