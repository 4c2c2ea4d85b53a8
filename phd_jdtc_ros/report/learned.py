"""The values that a tracker has learned of its sensors, beside the configured ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from msg_adapters import anomalies
from phd_jdtc_ros.configuration.radar_parameters import RadarParameters

# Components whose noise is learned, with the parameter and the unit of their noise.
NOISE = {
    "range": ("range_std", "m"),
    "azimuth": ("azimuth_std_deg", "\N{DEGREE SIGN}"),
    "range_rate": ("range_rate_std", "m/s"),
}


class LearnedValue(NamedTuple):
    """One learned value of a sensor."""

    sensor: str
    quantity: str  # Name of the parameter
    given: float  # The configured value
    found: float  # The learned value
    std: float  # Standard deviation of the learned value
    unit: str  # Unit of the three numbers; empty for a probability


def changes(inputs: Iterable[RadarParameters], figures: Mapping[str, float]) -> dict[str, str]:
    """Return the warnings about sensors that have changed, by sensor."""
    texts = {radar.name: anomalies.of_changes(radar.name, figures) for radar in inputs}
    return {name: text for name, text in texts.items() if text is not None}


def values(
    inputs: Iterable[RadarParameters], figures: Mapping[str, float]
) -> Iterator[LearnedValue]:
    """Yield the values that are learned of each sensor, by a step's `SensorMemory.figures`."""
    for radar in inputs:
        quantity = "detection_probability"
        name = f"{radar.name}.{quantity}"
        if name in figures:
            given, std = figures[f"{name}_set"], figures[f"{name}_std"]
            yield LearnedValue(radar.name, quantity, given, figures[name], std, "")
        for component, (quantity, unit) in NOISE.items():
            name = f"{radar.name}.{component}_noise_ratio"
            if name in figures:
                given = getattr(radar, quantity).start
                found, std = given * figures[name], given * figures[f"{name}_std"]
                yield LearnedValue(radar.name, quantity, given, found, std, unit)
