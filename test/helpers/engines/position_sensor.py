"""A sensor that measures positions: it implements the abstract members of `Sensor` only."""

from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.sensors.gaussians import PlanePlots
from phd_jdtc_ros.core.sensors.sensor import Sensor


@dataclass(frozen=True, kw_only=True)
class PositionSensor(Sensor):
    """Measures positions relative to its own, with the same noise along both axes."""

    std: float = 5.0

    @property
    def noise_std(self):
        return np.full(2, self.std)

    @property
    def field_size(self):
        return 1e6

    @property
    def log_uniform_clutter(self):
        return float(np.log(self.clutter_rate / self.field_size))

    def linearise(self, position):
        return position - self.position, np.broadcast_to(np.eye(2), (*position.shape, 2))

    def to_world(self, measurement):
        return measurement + self.position

    def log_jacobian(self, measured):
        return np.zeros(len(measured))

    def in_plane(self, detections):
        axes = np.broadcast_to(np.eye(2), (len(detections), 2, 2))
        return PlanePlots(
            self.to_world(detections.measurement), axes, self.noise_std_of(detections)
        )

    def draw_in_plane(self, detections, normal):
        position = self.to_world(detections.measurement)
        return position[:, None] + normal * self.noise_std_of(detections)[:, None]

    def gated_pairs(self, predicted, detections, rate=None):
        error = detections.measurement - predicted[:, None]
        square = ((error / self.noise_std_of(detections)) ** 2).sum(axis=2)
        row, column = np.nonzero(square < 36.0)
        return row, column, -0.5 * square[row, column]
