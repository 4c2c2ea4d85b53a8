"""A live tracker warns of a radar that is off the tracks that another one sees too."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live_radars import RELIABLE, SCANS, connected, options

from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.calibration.comparison import Comparison
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MeanResidual, RegistrationMonitor
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.nodes.tracker import settings
from phd_jdtc_ros.nodes.tracker.health import registration_status

FEW = {"lag": 0}
# Error of the second radar, whose noise is 300 m and 1 degree.
ERROR = SensorBias(range_bias=1000.0)
USED = 45


def residual(mean, sigma, count=LEAST, significant=(False, False)):
    return MeanResidual("mast", count, np.array(mean), np.array(sigma), significant)


@pytest.mark.parametrize(
    ("found", "level", "text"),
    [
        (residual([1.0, 1e-3], [2.0, 1e-3]), DiagnosticStatus.OK, "agrees with the other radars"),
        (
            residual([80.0, 0.0], [4.0, 1e-3], significant=(True, False)),
            DiagnosticStatus.WARN,
            "off the tracks that other radars see too: ranges +80 m (sigma 4); record a bag and "
            "run register",
        ),
        (
            residual(
                [80.0, math.radians(-0.3)], [4.0, math.radians(0.02)], significant=(True, True)
            ),
            DiagnosticStatus.WARN,
            "ranges +80 m (sigma 4), azimuths -0.3 degrees to the left (sigma 0.02)",
        ),
        (residual([80.0, 0.0], [4.0, 0.0], count=3), DiagnosticStatus.OK, "judged from 60"),
        (
            residual([80.0, 0.0], [4.0, 0.0], count=3)._replace(near=0.031),
            DiagnosticStatus.WARN,
            "off the tracks that other radars see too: 3 % of the expected detections are near",
        ),
    ],
)
def test_a_status_lists_the_bias_and_its_standard_deviation(found, level, text):
    status = registration_status(found, "/site/tracker")
    assert status.name == "/site/tracker: registration of mast"
    assert status.level == level
    assert text in status.message
    values = diagnostics.values_of(status)
    assert float(values["range_residual_m"]) == found.mean[0]
    assert float(values["azimuth_sigma_deg"]) == pytest.approx(math.degrees(found.sigma[1]))


def test_the_monitor_is_off_by_default_and_needs_two_radars():
    assert "registration" not in settings.resolve({}).node["outputs"]


@pytest.mark.live
def test_a_radar_that_is_off_is_warned_of_live_as_offline(processes, peer):
    config = resolve(FEW)
    sent = []
    for scan in SCANS[:USED]:
        wrong = ERROR.apply_to(scan.stamp_ns, scan.detections[1])[1]
        for index, found in enumerate((scan.detections[0], wrong)):
            sent.append((index, detections.to_msg(found, scan.stamp_ns, f"radar_{index + 1}")))

    pipeline, monitor = new_pipeline(config), RegistrationMonitor(config.model)
    comparison = Comparison(config.model, [monitor])
    for index, cloud in sent:
        report = detections.from_msg(cloud, config.inputs[index])
        for event in pipeline.add(index, report.stamp_ns, report.detections):
            assert isinstance(event, Stepped)
            comparison.add_scan(event.scan, event.step.filtered)
    expected = monitor.mean_residuals()
    assert expected[1].significant[0]

    words = options(**FEW, outputs="[registration]")
    processes.start("tracker", "--ros-args", *words, *RELIABLE)
    group = connected(peer)
    for number, (index, cloud) in enumerate(sent):
        group.outputs[index].publish(cloud)
        if index:
            done = (number + 1) // 2
            assert peer.spin_until(lambda done=done: len(group.filtered) >= done), number
    count = str(expected[1].residuals)
    found = group.health.until("registration of radar_2", lambda _, v: v["residuals"] == count)
    assert found.level == DiagnosticStatus.WARN
    assert "ranges +" in found.message
    values = diagnostics.values_of(found)
    assert float(values["range_residual_m"]) == pytest.approx(expected[1].mean[0], rel=1e-3)
    assert float(values["range_sigma_m"]) == pytest.approx(expected[1].sigma[0], rel=1e-3)
