"""The amplitudes of simulated clutter, and the block ``clutter`` of a scenario document.

The simulated law may differ from the tracker's assumption, its parameter `clutter_amplitude`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.special import ndtr, ndtri

from phd_jdtc_ros.configuration.schema import Parameter, parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.amplitude_density import (
    DB_PER_NEPER,
    SMALLEST_AMPLITUDE,
    level_db,
    snr_from_db,
)

from ..checked import by_radar, converted_parameter, read, take

LAW = Parameter(
    "law",
    "rayleigh",
    "Law of the envelopes.",
    choices=("rayleigh", "log_normal", "uniform"),
    required=True,
)
LEVELS_DB = (-100.0, 200.0)


@dataclass(frozen=True)
class RayleighClutter:
    """Noise, or clutter of many reflectors."""

    # Mean square of the envelope relative to that of noise; 1 is noise.
    level: float = converted_parameter(
        0.0, "Mean level, dB.", LEVELS_DB, snr_from_db, "level_db", required=True
    )

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        # The square of a Rayleigh envelope is exponential, so the truncated draw is exact.
        square = threshold**2 + 2.0 * self.level * rng.standard_exponential(count)
        envelope: FloatArray = np.sqrt(square)
        return envelope


@dataclass(frozen=True)
class LogNormalClutter:
    """Clutter whose level in dB is Gaussian."""

    median_db: float = parameter(0.0, "Median level, dB.", LEVELS_DB, "level_db", required=True)
    std_db: float = parameter(6.0, "Standard deviation, dB.", (0.1, 100.0), required=True)

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        least = (_level(threshold) - self.median_db) / self.std_db
        share = np.maximum(rng.random(count) * ndtr(-least), np.finfo(float).tiny)
        return _envelope(self.median_db - self.std_db * ndtri(share))


@dataclass(frozen=True)
class UniformClutter:
    """Clutter whose level is uniform in dB."""

    lowest_db: float = parameter(0.0, "Lowest level, dB.", LEVELS_DB, required=True)
    highest_db: float = parameter(0.0, "Highest level, dB.", LEVELS_DB, required=True)

    def draw(self, threshold: float, count: int, rng: np.random.Generator) -> FloatArray:
        """Return envelopes above a threshold, shape (count,)."""
        lowest = max(self.lowest_db, _level(threshold))
        return _envelope(rng.uniform(lowest, self.highest_db, count))


ClutterLaw: TypeAlias = RayleighClutter | LogNormalClutter | UniformClutter
NOISE = RayleighClutter(1.0)
LAWS: dict[str, type[ClutterLaw]] = {
    "rayleigh": RayleighClutter,
    "log_normal": LogNormalClutter,
    "uniform": UniformClutter,
}


def laws(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[ClutterLaw, ...]:
    """Return every radar's law, by default noise; empty if all are noise; add faults."""
    given = by_radar(document, "clutter", radars, faults)
    if not given:
        return ()
    return tuple(
        law_of(given[radar.name], f"clutter.{radar.name}.", radar, faults)
        if radar.name in given
        else NOISE
        for radar in radars
    )


def law_of(given: Any, prefix: str, radar: RadarModel, faults: list[str]) -> ClutterLaw:
    """Return a checked law; add its faults to `faults` and return noise if there are any."""
    if not isinstance(given, Mapping):
        faults.append(f"{prefix[:-1]}: must be a mapping")
        return NOISE
    declared = LAWS.get(str(given.get("law")))
    if declared is None:
        take((LAW,), given, prefix, faults)
        return NOISE
    law = read(declared, given, prefix, faults, ("law",))
    if isinstance(law, UniformClutter):
        least = max(law.lowest_db, _level(radar.threshold))
        if law.highest_db <= least:
            faults.append(
                f"{prefix}highest_db: {law.highest_db:g} given, must be above lowest_db and the "
                f"radar's threshold, {least:.1f} dB"
            )
    return law or NOISE


def _level(threshold: float) -> float:
    """Return the level of an envelope, dB."""
    return float(level_db(np.array(max(threshold, SMALLEST_AMPLITUDE))))


def _envelope(level: FloatArray) -> FloatArray:
    """Return the envelopes of levels in dB."""
    envelope: FloatArray = np.sqrt(2.0 * np.exp(level / DB_PER_NEPER))
    return envelope
