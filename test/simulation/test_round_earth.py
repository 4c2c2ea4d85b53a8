"""Radars on the round earth measure true slant ranges and azimuths from true north."""

import numpy as np
import pytest
from reference import resolve
from scenario_blocks import exact
from topocentric import seen_from

from msg_adapters.encoding import point_cloud
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

ORIGIN, PLACE = [52.3, 4.8, 5.0], [53.1, 6.9, 40.0]
PARAMETERS = {
    **exact("north", 300e3, geodetic=PLACE, rotation_s=4.0),
    "world_origin": ORIGIN,
    "north.units.azimuth_convention": "compass_cw",
    "north.units.azimuth": "deg",
    "north.fields.amplitude": "",
    "north.fields.height": "height",
    "classes": ["aircraft"],
    "births": [],
}
LEGS = [{"duration_s": 40.0}]
TARGETS = [
    {"class_id": 0, "position": place, "velocity": [200.0, -100.0], "legs": LEGS, "height": height}
    for place, height in [
        ([0.0, 0.0], 11000.0),
        ([300e3, 150e3], 6000.0),
        ([150e3, 85e3], 9000.0),
        ([-50e3, 80e3], -200.0),
    ]
]
TOPOCENTRIC = seen_from(*PLACE)
DOUBLE = point_cloud.FLOATS


def run(changes=None):
    config = resolve({**PARAMETERS, **(changes or {})}, SystemPlane)
    document = {"interval_s": 1.0, "scans": 41, "targets": TARGETS}
    scenario = scenario_file.resolve(document, config.model.radars)
    return config, scenario, simulate_reports(scenario, config.inputs, 3)


def expected(scenario, number, time_s):
    """Return the slant range, compass azimuth and plane position of a target, by PROJ."""
    x, _, y, *_ = scenario.flights[number - 1].states(np.array([time_s]))[0]
    latitude, longitude = SystemPlane(ORIGIN).to_geodetic(x, y)
    height = TARGETS[number - 1]["height"] + ORIGIN[2]
    east, north, up = TOPOCENTRIC.transform(float(longitude), float(latitude), height)
    slant = np.sqrt(east**2 + north**2 + up**2)
    return slant, np.degrees(np.arctan2(east, north)) % 360.0, (x, y), height


@pytest.mark.parametrize("yaw_deg", [0.0, 0.5])
def test_messages_have_true_slant_ranges_and_azimuths(yaw_deg):
    config, scenario, reports = run({"north.yaw_deg": yaw_deg})
    layout, start_ns = config.inputs[0], scenario.start_ns
    seen = set()
    for report in reports:
        cloud = adapter.to_msg(report.detections, report.stamp_ns, layout.frame, layout)
        columns = point_cloud.decode(
            cloud, dict.fromkeys(("range", "azimuth", "height", "time"), DOUBLE)
        )
        for row, number in enumerate(report.source.tolist()):
            time_s = (report.stamp_ns - start_ns) / 1e9 + report.detections.time_s[row]
            slant, compass, _, height = expected(scenario, number, time_s)
            assert columns["range"][row] == pytest.approx(slant, abs=0.05)
            apart = (columns["azimuth"][row] - compass - yaw_deg + 180.0) % 360.0 - 180.0
            # A sensor that is turned to the left reports compass azimuths that are too large.
            assert apart == pytest.approx(0.0, abs=5e-5)
            assert columns["height"][row] == pytest.approx(height, abs=1e-2)
            seen.add(number)
    assert seen == {1, 2, 3, 4}


@pytest.mark.parametrize("changes", [{}, {"north.fields.height": ""}])
def test_detections_are_where_a_reader_of_the_messages_finds_them(changes):
    config, _, reports = run(changes)
    (layout,) = config.inputs
    for report in reports:
        cloud = adapter.to_msg(report.detections, report.stamp_ns, layout.frame, layout)
        back = adapter.from_msg(cloud, layout).detections
        np.testing.assert_allclose(
            back.measurement[:, 0], report.detections.measurement[:, 0], rtol=0.0, atol=0.1
        )
        np.testing.assert_allclose(
            back.measurement[:, 1], report.detections.measurement[:, 1], rtol=0.0, atol=1e-6
        )


def test_detections_with_heights_are_at_their_targets():
    config, scenario, reports = run()
    (radar,) = config.model.radars
    for report in reports:
        found = radar.to_world(report.detections.measurement)
        for row, number in enumerate(report.source.tolist()):
            time_s = (report.stamp_ns - scenario.start_ns) / 1e9 + report.detections.time_s[row]
            _, _, place, _ = expected(scenario, number, time_s)
            np.testing.assert_allclose(found[row], place, rtol=0.0, atol=0.1)


def test_without_heights_high_targets_seem_too_far_away():
    _, _, known = run()
    _, _, unknown = run({"north.fields.height": ""})
    farther = [
        more.detections.measurement[row, 0] - less.detections.measurement[row, 0]
        for less, more in zip(known, unknown, strict=True)
        for row in np.flatnonzero(less.source == 1)
    ]
    # 11 km up at 170 km it is 350 m: the square of the height by twice the range.
    assert min(farther) > 200.0
