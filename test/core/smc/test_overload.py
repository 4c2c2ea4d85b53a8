# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.smc import overload
from phd_jdtc_ros.core.types import Detections

RADAR = small().model.radars[1]


def crowd(count, amplitude):
    rng = np.random.default_rng(0)
    measurement = np.stack([rng.uniform(0, 17e3, count), rng.uniform(-np.pi, np.pi, count)], axis=1)
    return Detections(measurement, amplitude)


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    monkeypatch.setattr(overload, "MOST_CANDIDATES", 5000)


PREDICTED = crowd(1000, None).measurement


def test_what_can_be_afforded_is_left_as_it_is():
    few = crowd(100, np.full(100, 5.0))
    assert overload.thinned(PREDICTED, few, RADAR) == (few, RADAR, 1.0)


def test_with_amplitudes_the_threshold_is_raised():
    rng = np.random.default_rng(1)
    amplitude = np.sqrt(RADAR.threshold**2 + 2.0 * rng.standard_exponential(20_000))
    many = crowd(20_000, amplitude)
    kept, raised, share = overload.thinned(PREDICTED, many, RADAR)
    assert share == 1.0
    assert RADAR.candidates(PREDICTED, kept) < 1.2 * overload.MOST_CANDIDATES
    assert sorted(kept.amplitude) == sorted(amplitude)[-len(kept) :]
    assert raised.threshold == kept.amplitude.min()
    # Clutter is above the new threshold as often as it was above the old one, and of one density.
    part = raised.clutter_rate / RADAR.clutter_rate
    assert part == pytest.approx(len(kept) / 20_000, rel=0.1)
    np.testing.assert_allclose(
        raised.log_clutter_intensity(kept), RADAR.log_clutter_intensity(kept), rtol=1e-12
    )


@pytest.mark.parametrize("amplitude", [None, 30.0])
def test_without_an_order_of_amplitudes_an_even_draw_is_kept(amplitude):
    many = crowd(20_000, None if amplitude is None else np.full(20_000, amplitude))
    kept, raised, share = overload.thinned(PREDICTED, many, RADAR)
    assert RADAR.candidates(PREDICTED, kept) < 1.2 * overload.MOST_CANDIDATES
    if amplitude is None:
        assert share == len(kept) / 20_000
        assert raised == RADAR
    quarters = np.histogram(kept.measurement[:, 1], 4, (-np.pi, np.pi))[0]
    assert quarters.max() < 1.3 * quarters.min()
