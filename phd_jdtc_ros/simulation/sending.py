"""The timing of radars' messages on a network; the block ``sending`` of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from phd_jdtc_ros.configuration.schema import Parameter
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from .checked import mapping, names_of, take

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
    given = mapping(document, "sending", faults)
    known = [radar.name for radar in radars]
    faults += [
        f"sending.{name}: must be one of the radars, {', '.join(known)}"
        for name in given
        if name not in known
    ]
    found = []
    for name in known:
        wrong: list[str] = []
        of_radar = mapping(given, name, wrong)
        values = take(SENDING, of_radar, f"sending.{name}.", wrong, names_of(SENDING))
        faults += wrong
        found.append(Sending() if wrong else Sending(**values))
    return tuple(found)
