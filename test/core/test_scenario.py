import math

import pytest

from phd_jdtc_ros.core import config, scenario
from phd_jdtc_ros.core.config import ConfigError

RADARS = config.resolve({}).model.radars
TARGET = {
    "class_id": 1,
    "snr_db": 20.0,
    "position": [1, 2.5],
    "velocity": [3.0, -4.0],
    "first_scan": 2,
    "last_scan": 7,
}


def faults_of(document):
    with pytest.raises(ConfigError) as caught:
        scenario.resolve(document, RADARS)
    return list(caught.value.faults)


def test_resolve_builds_what_the_document_says():
    found = scenario.resolve(
        {"start_s": 5.5, "interval_s": 2, "scans": 8, "targets": [TARGET]}, RADARS
    )
    (target,) = found.targets
    assert (found.start_ns, found.interval_s, found.scans) == (5_500_000_000, 2.0, 8)
    assert target.snr == pytest.approx(100.0)
    assert (target.class_id, target.first_scan, target.last_scan) == (1, 2, 7)
    assert (target.position, target.velocity) == ((1.0, 2.5), (3.0, -4.0))
    assert found.radars == RADARS


def test_resolve_of_an_empty_document_is_a_scene_of_clutter():
    found = scenario.resolve({}, RADARS)
    assert (found.targets, found.interval_s, found.scans) == ((), 6.0, 80)
    assert found.start_ns > 0


def test_resolve_lists_every_fault():
    wrong = {**TARGET, "snr_db": math.nan, "position": [1.0]}
    short = {key: value for key, value in TARGET.items() if key != "velocity"}
    faults = faults_of({"scans": 0, "colour": "red", "targets": [wrong, {**short, "size": 3}]})
    starts = sorted(fault.split(": ")[0] for fault in faults)
    assert starts == [
        "colour",
        "scans",
        "targets[0].position",
        "targets[0].snr_db",
        "targets[1].size",
        "targets[1].velocity",
    ]
    assert any("velocity: missing" in fault for fault in faults)


@pytest.mark.parametrize("document", [None, [], "scene", 3])
def test_resolve_refuses_a_document_that_is_no_mapping(document):
    assert faults_of(document) == ["scenario: must be a mapping"]


@pytest.mark.parametrize("targets", [{}, "all", [3], None])
def test_resolve_refuses_targets_that_are_no_list_of_mappings(targets):
    assert faults_of({"targets": targets}) == ["targets: must be a list of mappings"]
