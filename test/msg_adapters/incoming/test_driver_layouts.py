"""Clouds laid out as the drivers of the documentation's examples do, read with those examples."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.encoding import stamps
from msg_adapters.incoming import detections
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import from_arguments

PAGE = Path(__file__).parents[3] / "docs" / "drivers.md"
DATATYPES = {"f4": PointField.FLOAT32, "i1": PointField.INT8, "u1": 2, "u2": PointField.UINT16}
SMARTMICRO = dict.fromkeys(
    (
        *("x", "y", "z", "radial_speed", "power", "rcs", "noise", "snr"),
        *("azimuth_angle", "elevation_angle", "range"),
    ),
    "f4",
)
# A C++ compiler aligns the structure to 64 bytes; four of them after z are padding.
ARS548 = {
    **dict.fromkeys(("x", "y", "z", "padding_", "azimuth", "azimuth_std"), "f4"),
    **dict.fromkeys(("elevation", "elevation_std", "range", "range_std"), "f4"),
    **dict.fromkeys(("range_rate", "range_rate_std"), "f4"),
    **{"rcs": "i1", "measurement_id": "u2", "positive_predictive_value": "u1"},
    **{"classification": "u1", "multi_target_probability": "u1", "object_id": "u2"},
    "ambiguity_flag": "u1",
}


@pytest.fixture
def example(tmp_path):
    """Return a function that gives the radar with a topic, as the page configures it."""
    blocks = re.findall(r"^```yaml\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)

    def find(topic):
        for block in blocks:
            path = tmp_path / "example.yaml"
            path.write_text(block)
            for radar in resolve(from_arguments.load(path)).inputs:
                if radar.topic == topic:
                    return radar
        raise LookupError(topic)

    return find


def cloud(frame, kinds, size, **columns):
    layout = np.dtype(list(kinds.items()), align=True)
    step = -(-layout.itemsize // size) * size
    points = np.zeros((len(next(iter(columns.values()))), step), dtype=np.uint8)
    view = np.ndarray(len(points), layout, points, strides=(step,))
    for name, column in columns.items():
        view[name] = column
    return PointCloud2(
        header=stamps.header(1, frame),
        height=1,
        width=len(points),
        fields=[
            PointField(name=name, offset=layout.fields[name][1], datatype=DATATYPES[kind], count=1)
            for name, kind in kinds.items()
            if name != "padding_"
        ],
        point_step=step,
        row_step=points.size,
        data=points.tobytes(),
    )


def test_the_smartmicro_example_reads_its_drivers_clouds(example):
    radar = example("/smart_radar/port_targets_0")
    message = cloud(
        *("umrr_north", SMARTMICRO, 4),
        **{"range": [50.0, 100.0], "azimuth_angle": [0.25, -0.5], "snr": [10.0, 20.0]},
        power=[-60.0, -50.0],
    )
    report = detections.from_msg(message, radar)
    assert message.point_step == 44
    assert_allclose(report.detections.measurement, [[50.0, 0.25], [100.0, -0.5]])
    assert_allclose(report.detections.amplitude, np.sqrt([20.0, 200.0]))


def test_the_ars548_example_reads_its_drivers_clouds(example):
    message = cloud(
        *("continental", ARS548, 16),
        **{"range": [50.0, 100.0], "azimuth": [0.25, -0.5], "rcs": [-20, 10]},
    )
    report = detections.from_msg(message, example("/detection_points"))
    assert message.point_step == 64
    assert_allclose(report.detections.measurement, [[50.0, 0.25], [100.0, -0.5]])
    assert_allclose(report.detections.amplitude, np.sqrt([20.0, 20000.0]))
