"""Class probabilities of targets that keep their signal-to-noise ratio: as often right as said."""

import numpy as np
import pytest
from lone import INTERVAL_S, lone, scan_at, started

from phd_jdtc_ros.core.models.amplitude_model import Memory

TARGETS, SCANS = 400, 10
STD = np.array([50.0, 1.0, 50.0, 1.0, 1e-3])
GIVEN = {
    "classes": ["weak", "strong"],
    "weak.snr_band_db": [15.0, 32.0],
    "strong.snr_band_db": [25.0, 45.0],
    **{f"{name}.motions": ["cv"] for name in ("weak", "strong")},
    **{f"{name}.mode_transition": [1.0] for name in ("weak", "strong")},
    **{f"{name}.survival_probability": 1.0 for name in ("weak", "strong")},
    "radar.detection_probability": 0.0,
    "radar.range_std": 30.0,
    "radar.azimuth_std_deg": 0.02,
}


def class_probabilities(given):
    """Return the probability of the more probable class, and whether it is right, (T,)."""
    rng = np.random.default_rng(11)
    config = lone({**GIVEN, **given})
    (radar,), classes = config.model.radars, config.model.modes.classes
    # Targets are on a square grid, so far from each other that no gate has two of them.
    side = int(np.sqrt(TARGETS))
    place = 1.4e3 * (np.indices((side, side)).reshape(2, -1).T - 0.5 * side) + [200.0, 300.0]
    mean = np.zeros((TARGETS, 5))
    mean[:, [0, 2]] = place
    truth = mean + STD * np.array([1, 1, 1, 1, 0]) * rng.standard_normal((TARGETS, 5))
    class_of = rng.integers(0, 2, TARGETS)
    band = np.log1p([one.snr_band for one in classes])[class_of]
    snr = np.expm1(rng.uniform(band[:, 0], band[:, 1]))
    engine = started(config, *((0.999, one, STD) for one in mean))
    for scan in range(1, SCANS + 1):
        at = truth.copy()
        at[:, [0, 2]] += scan * INTERVAL_S * truth[:, [1, 3]]
        measured = radar.measure(at) + radar.noise_std * rng.standard_normal((TARGETS, 2))
        amplitude = rng.rayleigh(np.sqrt(1.0 + snr))
        seen = amplitude > radar.threshold
        step = engine.step(scan_at(scan * INTERVAL_S, measured[seen], amplitude[seen]))
    (found,) = step.filtered
    assert len(found) > 0.98 * TARGETS
    label = found.track_id - 1
    return found.class_probability.max(axis=1), found.class_id == class_of[label], config


@pytest.mark.parametrize("least", [0.5, 0.8, 0.95])
def test_classes_are_right_as_often_as_said_by_default(least):
    said, right, config = class_probabilities({"amplitude": "auto"})
    assert isinstance(config.model.amplitudes, Memory)
    sure = said >= least
    assert sure.sum() > 100
    spread = np.sqrt((said[sure] * (1.0 - said[sure])).sum()) / sure.sum()
    assert right[sure].mean() == pytest.approx(said[sure].mean(), abs=3.0 * spread + 0.005)
