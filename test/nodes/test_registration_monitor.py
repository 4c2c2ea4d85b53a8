"""A live tracker warns of a radar that is off the tracks that another one sees too."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_radars import RELIABLE, SCANS
from sensor_msgs.msg import PointCloud2

from msg_adapters import (
    detections,
    detections_in_map,
    diagnostics,
    names,
    point_cloud,
    stamps,
)
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MeanResidual, RegistrationMonitor
from phd_jdtc_ros.configuration import tracker_node
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.nodes.tracker.health import registration_status

NODE = "/tracker"
FEW = {"engine": "gaussian", "lag": 0}
# Error of the second radar, whose noise is 300 m and 1 degree.
ERROR = SensorBias(range_bias=1000.0)
USED = 45
WORLD = dict.fromkeys("xy", point_cloud.FLOATS)


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
    assert "registration" not in tracker_node.resolve({}).node["outputs"]


@pytest.mark.live
def test_a_radar_that_is_off_is_warned_of_live_as_offline(processes, peer):
    config = resolve(FEW)
    sent = []
    for scan in SCANS[:USED]:
        wrong = ERROR.apply_to(scan.stamp_ns, scan.detections[1])[1]
        for index, found in enumerate((scan.detections[0], wrong)):
            sent.append((index, detections.to_msg(found, scan.stamp_ns, f"radar_{index + 1}")))

    pipeline, monitor = new_pipeline(config), RegistrationMonitor(config.model.radars, 6.0)
    for index, cloud in sent:
        report = detections.from_msg(cloud, config.inputs[index])
        for event in pipeline.add(index, report.stamp_ns, report.detections):
            assert isinstance(event, Stepped)
            monitor.add_scan(event.scan, event.step.filtered)
    expected = monitor.mean_residuals()
    assert expected[1].significant[0]

    outputs = [peer.publisher(PointCloud2, f"/radar_{k}/detections", 50) for k in (1, 2)]
    filtered = peer.collect(PointCloud2, names.estimates("filtered"), 100)
    health = peer.collect(DiagnosticArray, names.DIAGNOSTICS)
    given = [word for name, value in FEW.items() for word in ("-p", f"{name}:={value}")]
    watch = ("-p", "outputs:=[registration]")
    processes.start("tracker", "--ros-args", *given, *watch, *RELIABLE)
    assert peer.spin_until(
        lambda: (
            all(output.get_subscription_count() for output in outputs)
            and peer.node.count_publishers(names.estimates("filtered"))
        )
    )
    peer.meet()
    for number, (index, cloud) in enumerate(sent):
        outputs[index].publish(cloud)
        if index:
            done = (number + 1) // 2
            assert peer.spin_until(lambda done=done: len(filtered) >= done), number

    def status(radar):
        every = [s for message in health for s in message.status]
        name = names.health(f"registration of {radar}", NODE)
        return ([s for s in every if s.name == name] or [None])[-1]

    def counted():
        found = status("radar_2")
        values = diagnostics.values_of(found) if found else {}
        return values.get("residuals") == str(expected[1].residuals)

    assert peer.spin_until(counted)
    assert status("radar_2").level == DiagnosticStatus.WARN
    assert "ranges +" in status("radar_2").message
    values = diagnostics.values_of(status("radar_2"))
    assert float(values["range_residual_m"]) == pytest.approx(expected[1].mean[0], rel=1e-3)
    assert float(values["range_sigma_m"]) == pytest.approx(expected[1].sigma[0], rel=1e-3)


@pytest.mark.live
def test_corrections_are_made_live(processes, peer):
    biases = [1000.0, 0.0, 0.0, 0.5]
    given = {**FEW, "radar_1.biases": biases, "radar_2.biases": biases}
    config = resolve(given)
    outputs = [peer.publisher(PointCloud2, f"/radar_{k}/detections", 50) for k in (1, 2)]
    seen = peer.collect(PointCloud2, names.detections_in_map(), 100)
    words = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    processes.start("tracker", "--ros-args", *words, *RELIABLE)
    assert peer.spin_until(lambda: all(output.get_subscription_count() for output in outputs))
    peer.meet()
    true = SCANS[0]
    for index, (output, layout) in enumerate(zip(outputs, config.inputs, strict=True)):
        stamp_ns, wrong = layout.bias.apply_to(true.stamp_ns, true.detections[index])
        output.publish(detections.to_msg(wrong, stamp_ns, layout.frame))
    assert peer.spin_until(lambda: seen)
    assert stamps.to_ns(seen[0].header.stamp) == true.stamp_ns
    exact = detections_in_map.to_msg(true, config.model.radars, config.world_frame)
    found, expected = (
        np.stack([point_cloud.decode(cloud, WORLD)[axis] for axis in WORLD], axis=1)
        for cloud in (seen[0], exact)
    )
    np.testing.assert_allclose(found, expected, atol=0.05)
