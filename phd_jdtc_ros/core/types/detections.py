"""Detections of a radar with their coverage and pose, and scans: the tracker's input."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly
from .reports import SelfReports

FULL_TURN = 2.0 * np.pi
# The columns of detections with one number per detection.
_PER_DETECTION = (
    *("amplitude", "time_s", "noise_correlation", "range_rate", "range_rate_std", "level", "rise"),
    *("height", "code", "address", "detection_type", "z", "z_std"),
)
# The columns with one row per detection.
_VELOCITIES = ("velocity", "velocity_std")
_COLUMNS = ("measurement", "noise_std", *_VELOCITIES, *_PER_DETECTION)
# Sensor types of detections: primary radar, secondary radar, Mode S.
SENSORS = ("psr", "ssr", "mds")


@dataclass(frozen=True)
class Coverage:
    """The azimuths that a radar's antenna swept for one report."""

    start: float  # First azimuth in the radar's frame, radians counter-clockwise from the x axis
    # Extent counter-clockwise from `start`, radians; more than 0 and at most 2 pi. An antenna that
    # turns clockwise sweeps it from end to start.
    width: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.start) and 0.0 < self.width <= FULL_TURN):
            raise ValueError(
                f"coverage: start {self.start}, width {self.width}, expected a finite start and a "
                "width above 0 and at most 2 pi"
            )

    @cached_property
    def part_of_revolution(self) -> float:
        """Part of a revolution; 0 if the swept azimuths are unknown."""
        return 0.0 if self == UNKNOWN_COVERAGE else self.width / FULL_TURN


# Coverage of a report without known coverage: its detections count, but it implies no misses.
UNKNOWN_COVERAGE = Coverage(0.0, 1e-9)


def rotation_of(yaw: float, tilt: tuple[float, float]) -> FloatArray:
    """Return the rotation from the frame of a pose to the world's, (3, 3); see `Pose`."""
    pitch, roll = tilt
    (c, s), (cos, sin) = ((math.cos(angle), math.sin(angle)) for angle in (pitch, roll))
    up = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    left = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    c, s = math.cos(yaw), math.sin(yaw)
    turn: FloatArray = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ up @ left
    return turn


def angles_of(rotation: FloatArray) -> tuple[float, tuple[float, float]]:
    """Return the yaw and the tilt of a rotation, see `rotation_of`."""
    (ahead, left, up), (across, above) = rotation[:, 0].tolist(), rotation[2, 1:].tolist()
    return math.atan2(left, ahead), (
        math.atan2(up, math.hypot(ahead, left)),
        math.atan2(across, above),
    )


LEVEL = (0.0, 0.0)


@dataclass(frozen=True)
class Pose:
    """Position, attitude and velocity of a sensor or its platform."""

    position: tuple[float, float]  # In the world frame, metres
    # Direction of its x axis in the world frame, radians counter-clockwise; NaN if unknown.
    yaw: float
    # In the world frame, metres per second; zero where it is not needed.
    velocity: tuple[float, float] = (0.0, 0.0)
    # Measured velocity ahead, to the left and upward, metres per second, and the rates of turn
    # about these axes, radians per second; None if unknown.
    twist: tuple[float, ...] | None = None
    # Height above the world's zero, metres, and climb rate, metres per second; 0 in the plane.
    height: float = 0.0
    climb: float = 0.0
    # Pitch, by which the x axis points up, and then roll, by which the left side is up, radians;
    # `LEVEL` in the plane.
    tilt: tuple[float, float] = LEVEL

    @property
    def rotation(self) -> FloatArray:
        """Rotation from its frame to the world's, (3, 3)."""
        return rotation_of(self.yaw, self.tilt)


@dataclass(frozen=True)
class Detections(ReadOnly):
    """Detections of one sensor in one scan, in the frame of that sensor."""

    # (M, Z). For the polar radar, range in metres and azimuth in radians counter-clockwise from the
    # sensor's x axis; for a sensor of positions, x and y in metres.
    measurement: FloatArray
    # Linear envelope in units of the noise's standard deviation per quadrature, (M,); NaN where
    # unknown. None if the radar reports none: the class likelihood is then neutral.
    amplitude: FloatArray | None
    # Time relative to the scan's stamp, seconds, (M,); None if all detections are at the stamp.
    time_s: FloatArray | None = None
    # Standard deviations in the units of the measurement, (M, Z); None for the radar model's.
    noise_std: FloatArray | None = None
    # The swept azimuths; None for the radar's whole field of view, `UNKNOWN_COVERAGE` if they are
    # unknown. Detections outside the coverage are valid.
    coverage: Coverage | None = None
    # Pose of the radar at the scan's stamp, to which all measurements are relative; None for the
    # radar model's.
    pose: Pose | None = None
    # Range rate relative to the radar, metres per second, (M,): positive for a receding target,
    # modulo the radar's ambiguity; NaN where unknown. None if the radar reports none.
    range_rate: FloatArray | None = None
    # Standard deviation of the range rate, metres per second, (M,). NaN, or None for all, stands
    # for the radar model's.
    range_rate_std: FloatArray | None = None
    # Cosine and sine of the elevation, (M,): what the range rate has of that in the plane, and of
    # the climb rate; NaN where unknown. None where all is level, and in space.
    level: FloatArray | None = None
    rise: FloatArray | None = None
    # Height above the world's zero, metres, (M,); NaN where unknown. None if the radar reports
    # none.
    height: FloatArray | None = None
    # Mode A code of the transponder's reply, 12 bits, (M,); `UNKNOWN` without one. None if the
    # radar reports none.
    code: IntArray | None = None
    # Mode S address of the reply, 24 bits, (M,); `UNKNOWN` without one. None if the radar reports
    # none.
    address: IntArray | None = None
    # Sensor type, the TYP of I048/020, (M,): 1 primary, 2 secondary, 3 both, 4 and 5 Mode S, 6 and
    # 7 Mode S and primary; `UNKNOWN` otherwise. None if the radar reports none.
    detection_type: IntArray | None = None
    # Correlation of the errors of both components of a measurement, (M,); NaN, or None for all, if
    # it is unknown. Errors with an unknown correlation, and those of a polar radar, are taken as
    # independent.
    noise_correlation: FloatArray | None = None
    # Velocity over ground along the axes of the sensor, metres per second, (M, 2), or (M, 3) with
    # that upward; NaN where unknown. None if the sensor reports none.
    velocity: FloatArray | None = None
    # Its standard deviations, metres per second, in the same shape. NaN, or None for all, stands
    # for the sensor model's.
    velocity_std: FloatArray | None = None
    # Height above the world's zero in the place of `height`, as a measurement of z in space,
    # metres, (M,); NaN where unknown. A pressure altitude if `Sensor.reported_heights` says so.
    z: FloatArray | None = None
    # Its standard deviation, metres, (M,). NaN, or None for all, stands for the sensor model's.
    z_std: FloatArray | None = None
    # Least x and y, and largest x and y, metres, of the area in which a sensor of positions saw
    # targets; None for the sensor model's.
    area: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        values, shape = self.__dict__, self.measurement.shape
        if self.measurement.ndim != 2:
            raise ValueError(f"measurement: expected shape (M, Z), got {shape}")
        for name in _COLUMNS:
            column, expected_shape = values[name], shape[:1] if name in _PER_DETECTION else shape
            if column is not None and name in _VELOCITIES:
                expected_shape = (*shape[:1], 3 if column.shape[1:] == (3,) else 2)
            if column is not None and column.shape != expected_shape:
                raise ValueError(f"{name}: expected shape {expected_shape}, got {column.shape}")

    def __len__(self) -> int:
        return len(self.measurement)

    def take(self, rows: IntArray) -> Detections:
        """Return the detections of these rows, in this order; coverage and pose stay the same."""
        values = self.__dict__
        columns = {name: values[name][rows] for name in _COLUMNS if values[name] is not None}
        return self.changed(**columns)


@dataclass(frozen=True)
class Scan:
    """All detections with a common stamp."""

    stamp_ns: int
    # One entry per radar, in the configured order. None if the radar did not report at this stamp:
    # the filter is then not updated with it, which differs from an update with zero detections.
    detections: tuple[Detections | None, ...]
    # Self-reports since the previous scan, late ones too; None without any.
    self_reports: SelfReports | None = None
