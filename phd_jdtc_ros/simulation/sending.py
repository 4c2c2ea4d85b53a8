"""The timing of radars' messages on a network; the block ``sending`` of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from phd_jdtc_ros.configuration.schema import parameter
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from .checked import read_by_radar


@dataclass(frozen=True)
class Sending:
    """The timing of a radar's messages."""

    sectors: int = parameter(
        32, "Number of sectors per revolution in which plots are sent.", (1, 1024)
    )
    plots: int = parameter(10, "Largest number of plots in a data block.", (1, 100))
    delay_s: float = parameter(0.3, "Delay of plots after the end of their sector, s.", (0.0, 60.0))
    services: bool = parameter(True, "Whether north marks and sector crossings are sent.")
    clock_ahead_s: float = parameter(
        0.0, "Lead of the radar's clock over true time, s.", (-86400, 86400)
    )


def of_radars(
    document: Mapping[str, object], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Sending, ...]:
    """Return the timing of each radar's messages in a document; add faults to `faults`."""
    given = read_by_radar(Sending, document, "sending", radars, faults)
    return tuple(each or Sending() for each in given)
