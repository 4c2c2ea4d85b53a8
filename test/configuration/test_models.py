"""The models of radars and targets that parameters describe, their places and heights."""

import math

import numpy as np
import pytest
from reference import resolve

from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.scene import differences, other_places
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.factors.clutter.amplitude import Learned
from phd_jdtc_ros.core.models.amplitude_model import Band, Memory
from phd_jdtc_ros.core.sensors.view import NOISE
from phd_jdtc_ros.core.targets import amplitude_density
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, CoordinatedTurn
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.earth import SystemPlane

NOT_SHOWN = {"radar_1.fields.amplitude": "", "radar_2.fields.amplitude": ""}
REFERENCE = resolve({}).values
ORIGIN, PLACE = [52.3, 4.8, 5.0], [53.1, 6.9, 40.0]
ONE = {"sensors": ["north"], "world_origin": ORIGIN, "north.geodetic": PLACE}


def test_the_reference_scene_has_two_radars_and_births_at_four_places():
    resolved = resolve({})
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
    assert resolved.budget.per_target == 1500
    assert resolved.world_frame == "map"


def test_resolve_converts_decibels_degrees_and_probabilities():
    radar = resolve({"radar_1.yaw_deg": 90.0}).model.radars[0]
    assert radar.yaw == pytest.approx(math.pi / 2.0)
    assert radar.azimuth_std == pytest.approx(math.pi / 180.0)
    assert radar.threshold == pytest.approx(amplitude_density.threshold_for(1e-3))


@pytest.mark.parametrize(
    ("convention", "seen", "hidden"),
    [("enu_ccw", [10.0, 89.0], [-1.0, 91.0]), ("compass_cw", [1.0, 80.0], [-1.0, 91.0])],
)
def test_field_of_view_is_counted_as_the_radar_counts(convention, seen, hidden):
    given = {"radar_1.units.azimuth_convention": convention, "radar_1.fov_deg": [0.0, 90.0]}
    radar = resolve(given).model.radars[0]
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
    model = resolve(given).model
    np.testing.assert_array_equal(model.modes.class_of, [0, 0, 1, 2, 2, 2])
    assert model.modes.motions[5] == ConstantVelocity(50.0)
    rates = np.array([8.0, 4.0, 9.0, 0.0, 0.0, 0.0]) * 1e-3 / 3.0
    np.testing.assert_allclose(model.births[0].rate, rates)


def test_the_law_of_clutter_is_that_of_noise_or_learned():
    model = resolve({"radar_1.clutter_amplitude": "learned"}).model
    nothing = Detections(np.zeros((0, 2)), None)
    first, second = model.expected(Scan(0, (nothing, nothing)))
    assert isinstance(first.clutter_amplitude, Learned)
    assert second.clutter_amplitude is NOISE


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
    model = resolve(given).model
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
    model = resolve(given).model
    np.testing.assert_allclose(
        model.spawn.transition, np.block([[np.array(from_a), from_b], [from_b, np.array(from_a)]])
    )


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({"engine": "gaussian"}, Memory),
        ({"engine": "gaussian", "amplitude": "band"}, Band),
        ({"engine": "gaussian", **NOT_SHOWN}, Band),
        ({"engine": "phd"}, Band),
    ],
)
def test_amplitude_auto_remembers_snrs_where_classes_of_gaussians_depend_on_them(given, kind):
    assert type(resolve(given).model.amplitudes) is kind


def test_amplitude_auto_of_one_class_has_no_snr_to_remember():
    given = {"engine": "gaussian", "classes": ["class_0"]}
    births = {f"start_{n}.rates": [0.01] for n in (1, 2, 3, 4)}
    assert type(resolve({**given, **births}).model.amplitudes) is Band


def test_differences_are_of_given_parts_that_both_scenes_have():
    other = resolve({"lag": 2, "seed": 9, "particles": [50], "start_1.rates": [0.1, 0.1]})
    assert differences(REFERENCE, other.values) == []
    given = resolve({"sensors": ["radar_2"], "radar_2.range_std": 9.0}).values
    assert differences(REFERENCE, given) == [
        "sensors: [radar_1, radar_2] recorded, [radar_2] given",
        "radar_2.range_std: 300.0 recorded, 9.0 given",
    ]
    assert differences(REFERENCE, {}) == []
    recorded = resolve({"radar_1.range_std": 100.0}).values
    given = {"radar_1.range_std": 300.0, "radar_1.detection_probability": 0.5}
    learned = {**given, "radar_1.learn": ["noise", "detection"]}
    assert differences(recorded, resolve(learned).values) == []
    assert differences(recorded, resolve({"radar_1.range_std": 300.0}).values) != []


@pytest.mark.parametrize("name", ["topic", "frame"])
def test_differences_takes_an_empty_name_for_the_default_it_stands_for(name):
    full = {"topic": "/radar_1/detections", "frame": "radar_1"}[name]
    given = resolve({f"radar_1.{name}": full}).values
    assert differences(REFERENCE, given) == []


def test_differences_leaves_birth_places_out_where_targets_are_born_at_detections():
    given = resolve({"births": [], "detection_births.rates": [0.1, 0.1]}).values
    assert differences(REFERENCE, given) == []
    assert differences(REFERENCE, resolve({"births": []}).values) != []


def test_other_places_are_those_recorded_of_radars_that_both_have():
    recorded = resolve({"sensors": ["a", "b"], "a.position": [1.0, 2.0], "a.pose": "/ship"}).values
    given = resolve({"sensors": ["a"], "a.yaw_deg": 3.0, "a.range_std": 5.0}).values
    assert other_places(recorded, given) == {
        "a.position": [1.0, 2.0],
        "a.yaw_deg": 0.0,
        "a.pose": "/ship",
    }
    assert other_places(recorded, recorded) == {}


def faults_of(given):
    with pytest.raises(ConfigError) as caught:
        resolve(given, SystemPlane)
    return caught.value.faults


def test_a_radar_on_the_earth_has_its_place_and_direction_in_the_plane():
    config = resolve({**ONE, "north.yaw_deg": 0.4}, SystemPlane)
    ((radar,), (layout,)) = config.model.radars, config.inputs
    plane = SystemPlane(ORIGIN)
    assert radar.position == tuple(map(float, plane.to_plane(*PLACE[:2])))
    expected = float(plane.convergence(*PLACE[:2])) + math.radians(0.4)
    assert radar.yaw == pytest.approx(expected, abs=1e-15)
    # North of the origin and to the east, meridians lean to the left by 1.7 degrees.
    assert math.degrees(radar.yaw) == pytest.approx(0.4 + 2.1 * math.sin(math.radians(53)), abs=0.1)
    assert config.plane == plane
    assert layout.site is not None
    assert (layout.height, layout.datum) == (35.0, 5.0)
    assert layout.assumed_height is None


def test_places_need_what_computes_on_the_earth():
    config = resolve({}, SystemPlane)
    assert config.plane is None
    assert all(layout.site is None and layout.datum == 0.0 for layout in config.inputs)
    with pytest.raises(ConfigError, match="world_origin: given, must be empty here"):
        resolve(ONE)
    recorded = resolve(ONE, SystemPlane).values
    lines = scene.differences(recorded, {**recorded, "world_origin": [52.3, 4.9, 5.0]})
    assert lines == ["world_origin: [52.3, 4.8, 5.0] recorded, [52.3, 4.9, 5.0] given"]
    assert scene.differences(recorded, recorded) == []


def test_a_radar_in_the_plane_of_an_origin_measures_over_the_plane():
    config = resolve(
        {"sensors": ["ship"], "world_origin": ORIGIN, "ship.pose": "/ship/odometry"}, SystemPlane
    )
    assert config.inputs[0].site is None
    assert config.inputs[0].datum == 5.0


def test_resolved_places_resolve_again_and_may_be_below_the_ellipsoid():
    given = {**ONE, "sensors": ["north", "radar_1"], "radar_1.geodetic": [52.0, 4.0, 10.0]}
    values = resolve(given, SystemPlane).values
    assert resolve(values, SystemPlane).values == values
    place = [31.5, 35.5, -300.0]
    config = resolve({**ONE, "world_origin": place, "north.geodetic": place}, SystemPlane)
    assert config.inputs[0].height == 0.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"world_origin": []},
            "world_origin: [] given, must be a place on the earth, as north.geodetic is one",
        ),
        (
            {"world_origin": [90.5, 4.8, 0.0]},
            "world_origin: [90.5, 4.8, 0.0] given, must be empty or a latitude from -90 to 90 "
            "degrees, a longitude from -360 to 360 degrees and a height in metres",
        ),
        (
            {"world_origin": [52.3, 4.8]},
            "world_origin: [52.3, 4.8] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [-91.0, 4.8, 0.0]},
            "north.geodetic: [-91.0, 4.8, 0.0] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [53.0, 400.0, 0.0]},
            "north.geodetic: [53.0, 400.0, 0.0] given, must be empty or a latitude",
        ),
        (
            {"north.geodetic": [61.3, 4.8, 0.0]},
            "north.geodetic: [61.3, 4.8, 0.0] given, is 1001 km from world_origin, must be at most "
            "500 km",
        ),
        (
            {"north.position": [10.0, 0.0]},
            "north.position: given beside geodetic, must be one of the two",
        ),
        ({"north.pose": "/ship/odometry"}, "north.pose: '/ship/odometry' given, must be fixed"),
        (
            {"north.assumed_height": [1.0, 2.0]},
            "north.assumed_height: [1.0, 2.0] given, must be empty or one height",
        ),
        (
            {"north.geodetic": [], "north.assumed_height": [6000.0]},
            "north.assumed_height: given without geodetic, must be empty",
        ),
        (
            {"world_origin": [math.nan, 4.8, 0.0]},
            "world_origin: [nan, 4.8, 0.0] given, must be empty or a latitude",
        ),
    ],
)
def test_resolve_reports_what_is_wrong_with_places(changes, expected):
    faults = faults_of({**ONE, **changes})
    assert len(faults) == 1
    assert faults[0].startswith(expected)
