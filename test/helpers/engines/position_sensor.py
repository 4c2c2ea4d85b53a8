"""A sensor that measures positions: it implements the abstract members of `Sensor`.

Its kind has all that a further kind of sensor needs: a model, a decoder with an encoder, and
parameters. `register` enters it in the tables of kinds and of decoders.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from msg_adapters.encoding import interfaces, names, point_cloud, stamps
from msg_adapters.incoming import readers
from msg_adapters.incoming.readers import Reader
from phd_jdtc_ros.columns.selection import Report
from phd_jdtc_ros.configuration import sensor_kinds
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.configuration.schema import POSITIVE, parameter
from phd_jdtc_ros.configuration.sensor_kinds import SensorKind
from phd_jdtc_ros.core.factors import Bursts, Limit
from phd_jdtc_ros.core.sensors.gaussians import PlanePlots, noise_covariance
from phd_jdtc_ros.core.sensors.sensor import Sensor
from phd_jdtc_ros.core.types import Detections

GATE_SIGMA = 6.0
COLUMNS = ("x", "y", "x_std", "y_std", "correlation")


def covariance_of(sensor, detections):
    """Return the covariance of each detection's noise, (M, Z, Z)."""
    return noise_covariance(sensor.noise_std_of(detections), detections.noise_correlation)


@dataclass(frozen=True, kw_only=True)
class PositionSensor(Sensor):
    """Measures positions relative to its own, everywhere in a square in which clutter is uniform.

    The standard deviation along both axes is that of detections without their own.
    """

    std: float = 5.0
    field_size: float = 1e6  # Area of the square, square metres
    detection_probability: float | None = None  # None if it follows from the SNR

    @property
    def noise_std(self):
        return np.full(2, self.std)

    def log_uniform_clutter(self, rate):
        return float(np.log(rate / self.field_size))

    @property
    def largest_detection_probability(self):
        return self.detection_probability

    def linearise(self, position):
        return position - self.position, np.broadcast_to(np.eye(2), (*position.shape, 2))

    def to_world(self, measurement):
        return measurement + self.position

    def log_jacobian(self, measured):
        return np.zeros(len(measured))

    def in_plane(self, detections):
        covariance = covariance_of(self, detections)
        return PlanePlots.of(self.to_world(detections.measurement), covariance)

    def gated_pairs(self, predicted, detections, rate=None):
        covariance = covariance_of(self, detections)
        error = detections.measurement - predicted[:, None]
        if rate is not None and detections.time_s is not None:
            error = error - rate[:, None] * detections.time_s[:, None]
        square = np.einsum("nmi,mij,nmj->nm", error, np.linalg.inv(covariance), error)
        row, column = np.nonzero(square <= GATE_SIGMA**2)
        log_scale = 0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1]
        return row, column, -0.5 * square[row, column] - log_scale[column]


# The other fields of a sensor that has a place and clutter.
MAST = {
    "name": "mast",
    "position": (500.0, -300.0),
    "yaw": 0.0,
    "threshold": 3.0,
    "clutter_rate": 4.0,
}


@dataclass(frozen=True)
class Positions(SensorParameters):
    message: str = parameter("positions", "Type.", choices=("positions",))
    std: float = parameter(5.0, "Standard deviation of positions, m.", POSITIVE)
    detection_probability: float = parameter(0.9, "Detection probability.", (0.0, 1.0))
    clutter_rate: float = parameter(1.0, "False reports per scan.", POSITIVE)
    width: float = parameter(1000.0, "Width of the covered square, m.", POSITIVE)


def model(own):
    return PositionSensor(
        name=own.name,
        position=(0.0, 0.0),
        yaw=0.0,
        threshold=3.0,
        clutter_rate=own.clutter_rate,
        std=own.std,
        field_size=own.width**2,
        detection_probability=own.detection_probability,
    )


def factors(own):
    return Limit(), Bursts()


def from_msg(cloud, sensor):
    columns = point_cloud.decode(cloud, dict.fromkeys(COLUMNS, point_cloud.FLOATS))
    x, y, x_std, y_std, correlation = (columns[name].astype(float) for name in COLUMNS)
    detections = Detections(
        np.stack([x, y], axis=1),
        None,
        noise_std=np.stack([x_std, y_std], axis=1),
        noise_correlation=correlation,
    )
    return Report(stamps.of_header(cloud.header), detections, Counter())


def to_cdr(detections, stamp_ns, sensor):
    values = (*detections.measurement.T, *detections.noise_std.T, detections.noise_correlation)
    columns = dict(zip(COLUMNS, values, strict=True))
    return point_cloud.to_cdr(stamp_ns, sensor.frame, columns)


def register(monkeypatch, checks=()):
    """Enter the kind ``position`` in the table of kinds, and its message in that of decoders."""
    monkeypatch.setitem(
        sensor_kinds.KINDS, "position", SensorKind(Positions, model, factors, checks)
    )
    monkeypatch.setitem(sensor_kinds.TABLES, "position", sensor_kinds._table(Positions))
    reader = Reader(
        names.CLOUD,
        from_msg,
        lambda data, sensor: from_msg(interfaces.decode(data, names.CLOUD), sensor),
        to_cdr,
    )
    monkeypatch.setitem(readers.READERS, "positions", reader)
