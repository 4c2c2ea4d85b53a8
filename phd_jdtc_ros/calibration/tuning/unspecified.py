"""The tracker for a recording without a configuration: one class, born at detections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .findings import LEAST_DENSITY, SPEED_MARGIN, Findings
from .rounding import round_to_std

# Looks of the smoother's lag, and least displacement by acceleration in this time, as a share of
# the range's standard deviation. As displacement in a single look, it would exceed the
# accelerations of slow targets by far where looks are frequent.
LAG_LOOKS, LEAST_OFF_COURSE = 5.0, 0.1
# Least standard deviation of the heights of undetected targets, metres, and their floor in standard
# deviations below the mean.
LEAST_HEIGHT_STD, FLOOR_SIGMA = 5.0, 3.0


def unspecified(found: Mapping[str, Findings]) -> dict[str, Any]:
    """Return the tracker's parameters outside the sections of at least one radar."""
    first = min(found.values(), key=lambda each: each.timing.look_s)
    look_s = first.timing.look_s
    longest_s = max(each.timing.look_s for each in found.values())
    turning = [each.timing.rotation_s for each in found.values() if each.timing.rotation_s]
    noise = first.likelier_noise
    floor = 3.0 * (LEAST_OFF_COURSE * noise.range_std) ** 2 / (LAG_LOOKS * look_s) ** 3
    calm = max(noise.densities[0], floor, LEAST_DENSITY)
    hard = max(noise.densities[1], calm)
    given: dict[str, Any] = {
        "engine": "gaussian",
        "interval_s": round_to_std(look_s, 1e-3 * look_s),
        # What only the slowest sensor sees is smoothed too.
        "lag_s": round_to_std(LAG_LOOKS * longest_s, 0.1 * longest_s),
        "classes": ["target"],
        "births": [],
        # In a look of a fast sensor hardly any target is new: a false detection is no target there.
        "detection_births.rates": [round(0.2 * min(look_s, 1.0), 4)],
        "detection_births.std": [round_to_std(SPEED_MARGIN * first.speed_std, 0.1), 0.02],
        "spawn.rate": 0.0,
        "target.survival_probability": _survival_probability(found, look_s),
    } | _three_motions(calm, hard)
    heights = [each.elevations.heights for each in found.values() if each.elevations]
    if heights:
        own = heights[0]
        std = max(own[1], LEAST_HEIGHT_STD)
        floor = own[0] - FLOOR_SIGMA * std
        given["height_prior"] = [round_to_std(each, 0.1 * std) for each in (own[0], std, floor)]
    if turning:
        given["estimates_period_s"] = given["interval_s"]
    return given | _amplitude_band(found)


def _three_motions(calm: float, hard: float) -> dict[str, Any]:
    """Return straight motion, turns and rare manoeuvres, as in the profile for air traffic.

    Speeds change as little in turns as in straight motion, by the `calm` level of accelerations,
    m^2/s^3. Manoeuvres have the `hard` one, which braking and accelerating need.
    """
    names = ["cv", "ct", "hard"]
    turn = {"model": "coordinated_turn", "turn_time_constant_s": 40.0}
    by_motion = {
        "cv": {"model": "constant_velocity", "noise_density": round_to_std(calm, calm)},
        "ct": {**turn, "noise_density": round_to_std(calm, calm), "turn_noise_density": 1e-4},
        "hard": {**turn, "noise_density": round_to_std(hard, hard), "turn_noise_density": 2e-3},
    }
    return {
        "motions": names,
        "target.motions": names,
        "target.mode_transition": [0.949, 0.05, 0.001, 0.1, 0.899, 0.001, 0.1, 0.1, 0.8],
        **{f"{name}.{key}": each for name in names for key, each in by_motion[name].items()},
    }


def _survival_probability(found: Mapping[str, Findings], look_s: float) -> float:
    """Return the probability that a target survives a look of a length in seconds.

    Each radar's tracks bound the rate of disappearances from above; the lowest bound counts.
    """
    rate = min(each.ends.value / each.timing.look_s for each in found.values())
    # Least probability that a target survives a look. Lost tracks would make a lower one too low.
    return max(0.99, round(1.0 - round_to_std(rate * look_s, rate * look_s), 6))


def _amplitude_band(found: Mapping[str, Findings]) -> dict[str, Any]:
    """Return the band of the targets' SNRs if every radar's amplitudes exceed a threshold."""
    # The SNR band is wider than the tracks' levels by this much on either side, dB.
    beside_db = 5.0
    known = [each.levels for each in found.values() if each.levels is not None]
    usable = [
        levels for levels in known if levels.noise_is_known and math.isfinite(levels.target_db[0])
    ]
    if len(usable) < len(found):
        return {"amplitude": "none"}
    low = min(levels.target_db[0] for levels in usable) - beside_db
    high = max(levels.target_db[1] for levels in usable) + beside_db
    return {"amplitude": "band", "target.snr_band_db": [round(low, 1), round(high, 1)]}
