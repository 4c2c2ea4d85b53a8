import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.scene import differences, other_places

REFERENCE = resolve({}).values


def test_differences_are_of_given_parts_that_both_scenes_have():
    other = resolve({"lag": 2, "seed": 9, "particles_per_target": 50, "start_1.rates": [0.1, 0.1]})
    assert differences(REFERENCE, other.values) == []
    given = resolve({"sensors": ["radar_2"], "radar_2.range_std": 9.0}).values
    assert differences(REFERENCE, given) == [
        "sensors: [radar_1, radar_2] recorded, [radar_2] given",
        "radar_2.range_std: 300.0 recorded, 9.0 given",
    ]
    assert differences(REFERENCE, {}) == []
    recorded = resolve({"radar_1.range_std": 100.0}).values
    learned = {"radar_1.range_std": "auto 300", "radar_1.detection_probability": "auto 0.5"}
    assert differences(recorded, resolve(learned).values) == []
    assert differences(recorded, resolve({"radar_1.range_std": 300.0}).values) != []


def test_differences_names_every_parameter_with_both_values():
    given = resolve(
        {
            "classes": ["class_1", "class_0"],
            "radar_2.clutter_rate": 50.0,
            "start_4.position": [0.0, 1.0],
            "class_0.snr_band_db": [40.0, 50.0],
        }
    )
    assert differences(REFERENCE, given.values) == [
        "radar_2.clutter_rate: 20.0 recorded, 50.0 given",
        "classes: [class_0, class_1] recorded, [class_1, class_0] given",
        "class_0.snr_band_db: [30.0, 50.0] recorded, [40.0, 50.0] given",
        "start_4.position: [1400.0, 8000.0] recorded, [0.0, 1.0] given",
    ]


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
