"""The models of radars and targets that parameters describe."""

import math

import numpy as np
import pytest

from phd_jdtc_ros.configuration import build
from phd_jdtc_ros.configuration.engines import particle_filter
from phd_jdtc_ros.core.clutter.amplitude_law import Learned, LogNormal, Rayleigh
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn


def test_resolve_of_nothing_is_the_reference_scene():
    resolved = build.resolve({})
    model = resolved.model
    assert [radar.position for radar in model.radars] == [(1000.0, 0.0), (0.0, 0.0)]
    assert [c.snr_band for c in model.modes.classes] == [
        (pytest.approx(1e3), pytest.approx(1e5)),
        (pytest.approx(10.0), pytest.approx(1e3)),
    ]
    assert model.modes.motions == (
        ConstantVelocity(0.2),
        CoordinatedTurn(1.0, 1e-4),
        ConstantVelocity(0.2),
        CoordinatedTurn(1.0, 1e-4),
    )
    assert len(model.births) == 4
    for birth in model.births:
        # Both classes with mass 0.005; targets fly straight for twice as long as they turn.
        np.testing.assert_allclose(birth.rate, np.array([2.0, 1.0, 2.0, 1.0]) * 0.005 / 3.0)
        np.testing.assert_allclose(birth.std, [200.0, 40.0, 200.0, 40.0, 1e-3])
    assert resolved.lag.scans == 5
    assert resolved.lag.seconds is None
    assert particle_filter(resolved).budget.per_target == 1500
    assert resolved.world_frame == "map"


def test_resolve_converts_decibels_degrees_and_probabilities():
    radar = build.resolve({"radar_1.yaw_deg": 90.0}).model.radars[0]
    assert radar.yaw == pytest.approx(math.pi / 2.0)
    assert radar.azimuth_std == pytest.approx(math.pi / 180.0)
    assert radar.threshold == pytest.approx(amplitude_density.threshold_for(1e-3))


@pytest.mark.parametrize(
    ("convention", "seen", "hidden"),
    [("enu_ccw", [10.0, 89.0], [-1.0, 91.0]), ("compass_cw", [1.0, 80.0], [-1.0, 91.0])],
)
def test_field_of_view_is_counted_as_the_radar_counts(convention, seen, hidden):
    given = {"radar_1.azimuth_convention": convention, "radar_1.fov_deg": [0.0, 90.0]}
    radar = build.resolve(given).model.radars[0]
    for azimuths, expected in ((seen, 1.0), (hidden, 0.0)):
        measured = np.stack([np.full(2, 5e3), np.radians(azimuths)], axis=1)
        assert radar.visibility.probability_in_view(measured).tolist() == [expected] * 2


def test_resolve_builds_three_classes_of_different_motions():
    given = {
        "classes": ["a", "b", "c"],
        "motions": ["cv", "ct", "wild"],
        "a.motions": ["cv", "ct"],
        "b.motions": ["ct"],
        "b.mode_transition": [1.0],
        "c.motions": ["cv", "ct", "wild"],
        "c.mode_transition": [0.8, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8],
        "wild.noise_density": 50.0,
        **{f"start_{n}.rates": [0.004, 0.003, 0.0] for n in range(1, 5)},
    }
    model = build.resolve(given).model
    np.testing.assert_array_equal(model.modes.class_of, [0, 0, 1, 2, 2, 2])
    assert model.modes.motions[5] == ConstantVelocity(50.0)
    rates = np.array([8.0, 4.0, 9.0, 0.0, 0.0, 0.0]) * 1e-3 / 3.0
    np.testing.assert_allclose(model.births[0].rate, rates)


@pytest.mark.parametrize(
    ("given", "law"),
    [
        ("rayleigh", Rayleigh(1.0)),
        ("rayleigh 10", Rayleigh(10.0)),
        ("log_normal 20.0", LogNormal(20.0, 6.0)),
        ("learned", None),
    ],
)
def test_the_law_of_clutter_may_have_a_level(given, law):
    radar = build.resolve({"radar_1.clutter_amplitude": given}).model.radars[0]
    assert radar.clutter_amplitude == law or (
        law is None and isinstance(radar.clutter_amplitude, Learned)
    )


def test_a_spawned_target_has_its_parents_motion_as_a_rule():
    model = build.resolve({}).model
    same = [[0.45, 0.05], [0.05, 0.45]]
    np.testing.assert_allclose(model.spawn.transition, np.tile(same, (2, 2)))


def test_a_spawned_target_has_its_parents_motion_wherever_its_class_lists_it():
    given = {
        "classes": ["a", "b", "c"],
        "a.motions": ["cv", "ct"],
        "b.motions": ["ct", "cv"],
        "c.motions": ["ct"],
        "c.mode_transition": [1.0],
        **{f"start_{n}.rates": [0.004, 0.003, 0.0] for n in range(1, 5)},
    }
    cv, ct = [0.9, 0.1, 0.1, 0.9, 1.0], [0.1, 0.9, 0.9, 0.1, 1.0]
    model = build.resolve(given).model
    np.testing.assert_allclose(model.spawn.transition, np.array([cv, ct, ct, cv, ct]) / 3)


def test_a_spawned_target_of_a_class_without_its_parents_motion_has_any_of_it():
    given = {
        "classes": ["a", "b"],
        "motions": ["cv", "ct", "wild", "calm"],
        "a.motions": ["cv", "ct"],
        "b.motions": ["wild", "calm"],
        "wild.noise_density": 50.0,
        "calm.noise_density": 0.5,
    }
    from_a, from_b = [[0.45, 0.05], [0.05, 0.45]], np.full((2, 2), 0.25)
    model = build.resolve(given).model
    np.testing.assert_allclose(
        model.spawn.transition, np.block([[np.array(from_a), from_b], [from_b, np.array(from_a)]])
    )
