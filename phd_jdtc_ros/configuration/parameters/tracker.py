"""The parameters of the tracker: names, defaults, units and bounds.

Parameters are flat dotted names with plain values, as in ROS. Four lists name the parts (`sensors`,
`classes`, `motions`, `births`), and every name in them has parameters of its own, such as
``radar_1.range_std``. The defaults are two radars and targets of two classes that can appear
anywhere. Units are SI unless a suffix names another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.sensors.gaussians import STANDARD_HPA, Air, HeightPrior
from phd_jdtc_ros.core.targets.motion import MOTIONS
from phd_jdtc_ros.core.tracks.region import Region

from ..schema import INFINITY, NOT_NEGATIVE, POSITIVE, SMALL, parameter
from . import place_forms, replaced
from .sensor import SensorParameters

# Largest numbers of names: every class needs a matrix logarithm and every name has parameters, so
# that more names would delay the start by seconds.
MOST_SENSORS, MOST_CLASSES, MOST_MOTIONS, MOST_BIRTHS = 100, 50, 50, 1000
# The engines whose estimates have labels, and the PHD filters, which have what the paper has.
LABELLED = ("gaussian",)
SPACE = "space"  # The value of `state` with heights
PHD = ("phd", "phd_as_printed", "phd_gaussian")


@dataclass(frozen=True)
class Tracking:
    """The parameters of the whole tracker."""

    world_frame: str = parameter("map", "Frame of the estimates (ENU, metres).")
    world_origin: list[float] = parameter(
        [],
        "Latitude and longitude of the world frame's origin (WGS84, degrees) and height of its "
        "zero (m): x and y are then in the stereographic plane about it. The height alone if the "
        "place is unknown: the earth is round, and no output has latitudes and longitudes. Empty "
        "for a world frame over a plane.",
        form=place_forms.PLACE_OR_HEIGHT,
    )
    sensors: list[str] = parameter(
        ["radar_1", "radar_2"],
        "Names of the sensors, in the order in which their reports update the targets.",
        element=str,
        most=MOST_SENSORS,
    )
    classes: list[str] = parameter(
        ["class_0", "class_1"], "Names of the target classes.", element=str, most=MOST_CLASSES
    )
    motions: list[str] = parameter(
        ["calm", "cv", "ct"], "Names of the motion models.", element=str, most=MOST_MOTIONS
    )
    births: list[str] = parameter(
        [], "Names of the birth terms, at known places.", element=str, most=MOST_BIRTHS
    )
    state: str = parameter(
        "plane",
        "Axes of the targets' states: plane, or space with height and climb rate. In space ranges "
        "are slant ranges, and elevations are measurements.",
        choices=("plane", SPACE),
    )
    height_prior: HeightPrior = parameter(
        [0.0, 5000.0, 0.0],
        "Heights of undetected targets in the world frame, m: mean and standard deviation of a "
        "normal distribution, and its floor (0). It places targets born at detections without an "
        "elevation; a height is reported once it is known to half of the deviation. Only with "
        "state: space.",
        form=place_forms.HEIGHTS,
    )
    air: Air = parameter(
        [STANDARD_HPA, 12.0],
        "Air pressure at sea level and its standard deviation, hPa, by which reported heights, "
        "which are pressure altitudes, differ from those of the states: 8 m for each hPa, and the "
        "deviation is that of the temperature too, 40 m in 1 km for 10 degrees. The difference is "
        "estimated where elevations show it. Empty for geometric heights. Only with state: space.",
        name="qnh_hpa",
        form=place_forms.QNH,
    )
    interval_s: float = parameter(
        6.0,
        "Nominal interval of rates, probabilities and mode matrices, s. They are converted to the "
        "true intervals between scans.",
        (1e-3, 1e4),
    )
    max_gap_scans: float = parameter(
        15.0,
        "Longest gap between scans within a run, in intervals or in revolutions if these are "
        "longer. A longer gap starts a new run.",
        (2.0, 1e6),
    )
    reorder_s: float = parameter(
        0.0,
        "Longest time for which detections wait for other sensors' delayed detections of the same "
        "time, s. With 0 they wait for turning radars alone, one and a half times as long as a "
        "report of these covers.",
        (0.0, 1e3),
    )
    late_reports: str = parameter(
        "drop",
        "Treatment of out-of-sequence reports: drop and count them, or rework, which processes the "
        "scans since then again while their smoothed estimates are pending.",
        choices=("drop", "rework"),
    )
    region: Region | None = parameter(
        [],
        "Region of a tracker that shares an area with others: [x_min, y_min, x_max, y_max, margin] "
        "in the world frame, m. Detections and tracks beyond the margin are ignored; empty for no "
        "bounds.",
        form=place_forms.REGION,
    )
    estimates_period_s: float = parameter(
        0.0,
        "Period of estimates, s, all predicted to a common stamp; 0 for estimates with every scan.",
        (0.0, 1e4),
    )
    engine: str = parameter(
        "gaussian",
        "The filter: a Gaussian mixture for each target, or the paper's PHD filter with its "
        "corrections (phd), as printed, or with its corrections in closed form (phd_gaussian).",
        choices=(*LABELLED, *PHD),
        former=replaced.engine,
    )
    accuracy: str = parameter(
        "normal",
        "Accuracy against CPU time: fast mixes the motion models in every scan, high doubles the "
        "number of hypotheses, and for a PHD filter that of particles.",
        choices=("fast", "normal", "high"),
    )
    lag_scans: int = parameter(
        5, "Smoothing lag, scans.", (0, 100), name="lag", former=replaced.lag
    )
    lag_s: float = parameter(
        0.0,
        "Smoothing lag, s, instead of lag; for radars without common scans. 0 for lag.",
        (0.0, 1e5),
    )
    existence: tuple[float, float] = parameter(
        [0.0, 0.0],
        "Existence probabilities above which a track is confirmed and reported (or a PHD filter "
        "reports a target), and below which a confirmed track is deleted (not used by PHD "
        "filters). 0 derives them from the detection probabilities, and the second from the "
        "track's missed detections too; the first is 0.5 for a PHD filter.",
        form=place_forms.beginning_of((0.0, 0.0), 0.0, 1.0),
        mutable=True,
    )
    coasting: tuple[float, float] = parameter(
        [10.0, 10.0],
        "Time for which a track outside all coverage is reported, in intervals or in revolutions "
        "if these are longer, and the largest spread of a reported track, in gates of five "
        "standard deviations of the noise of a radar that reports, by area; not used by PHD "
        "filters. A track keeps its number if it is detected later.",
        form=place_forms.beginning_of((10.0, 10.0), 0.0, 1e6),
        mutable=True,
    )
    report_resting: bool = parameter(
        False,
        "Whether targets of a class that is only stationary are reported, such as reflectors and "
        "moored boats. They are tracked in any case.",
        mutable=True,
    )
    amplitude: str = parameter(
        "auto",
        "Use of amplitudes: band infers the class from its SNR band as if each detection had "
        "another SNR, memory estimates each target's SNR as well, none ignores amplitudes. auto is "
        "memory with several classes, and band with one class or a PHD filter.",
        choices=("auto", "band", "memory", "none"),
    )
    seed: int = parameter(0, "Seed of a PHD filter's random generator.", (0, 2**31 - 1))
    particles: tuple[int, int] = parameter(
        [0, 0],
        "Particles of a PHD filter per target after resampling, and per birth term, a power of "
        "two; 0 for the number that accuracy sets.",
        form=place_forms.beginning_of((0, 0), 0, 10**6, whole=True),
    )
    birth_rates: list[float] = parameter(
        [0.1],
        "Expected births per interval anywhere in the coverage, one number per class, or one for "
        "all classes, which share it; the targets start at detections. Empty for births at the "
        "birth terms only.",
        (0.0, 1e3),
        name="detection_births.rates",
    )
    birth_std: tuple[float, float, float] = parameter(
        [40.0, 1e-3, 5.0],
        "Standard deviations of the velocity of a target born at a detection, per axis, m/s, of "
        "its turn rate, rad/s, and of its climb rate, m/s, which is only used with state: space.",
        name="detection_births.std",
        form=place_forms.beginning_of((40.0, 1e-3, 5.0), SMALL, 1e6),
    )
    birth_least_probability: float = parameter(
        1e-4,
        "Smallest probability that a detection comes from a new target for which a target is born "
        "at it, and smallest probability that a target exists with which it is kept. A larger "
        "value takes less time, and loses targets that are missed soon after their first "
        "detection. If all births are less probable, as in dense clutter, half of their usual "
        "probability replaces it.",
        (1e-12, 0.5),
        name="detection_births.least_probability",
    )
    equipped_probability: float = parameter(
        0.9,
        "Probability that a target has a transponder, if radars report codes or addresses.",
        (0.001, 0.999),
        mutable=True,
    )
    shared_codes: list[str] = parameter(
        ["0000", "1000", "2000", "7000", "7500", "7600", "7700", "7777"],
        "Mode A codes that several targets can have, four octal digits each.",
        element=str,
        mutable=True,
    )
    conflicts_distance: tuple[float, float] = parameter(
        [],
        "Distance between own ship and a track, or between two tracks, below which they are in "
        "conflict, m, and if heights matter the difference of two known heights from which on they "
        "are not, m. Empty for no such conflicts.",
        form=place_forms.APART,
        name="conflicts.distance",
    )
    conflicts_horizon_s: float = parameter(
        360.0,
        "Time for which conflicts are predicted, s.",
        (1.0, 7200.0),
        name="conflicts.horizon_s",
    )
    conflicts_alarms_per_hour: float = parameter(
        6.0,
        "Largest number of alarms of conflicts in an hour: those of the largest probabilities are "
        "raised, and in any case those above 0.9.",
        (0.0, 1e4),
        name="conflicts.alarms_per_hour",
    )
    zones: str = parameter(
        "",
        "File of GeoJSON with polygons, each with the properties name and kind (guard, exclusion "
        "or land). Their entry is a conflict, and no track starts in an exclusion zone; empty for "
        "none. Needs world_origin.",
    )
    spawn_rate: float = parameter(
        0.0, "Expected spawned targets per target and interval.", (0.0, 1.0), name="spawn.rate"
    )

    def birth_rates_of(self, classes: int) -> list[float]:
        """Return the expected births at detections of each of so many classes, per interval."""
        rates = self.birth_rates or [0.0]
        return rates if len(rates) == classes else [rates[0] / classes] * classes

    @property
    def lag(self) -> Lag:
        """The smoothing lag."""
        return Lag(0, self.lag_s) if self.lag_s else Lag(self.lag_scans)


@dataclass(frozen=True)
class TargetClass:
    """The parameters of a class of targets."""

    snr_band_db: list[float] = parameter(
        [10.0, 50.0], "Lowest and highest mean SNR, dB.", (-100.0, 200.0), length=2
    )
    motions: list[str] = parameter(["calm", "cv", "ct"], "Motion models of the class.", element=str)
    mode_transition: list[float] = parameter(
        [0.96, 0.02, 0.02, 0.1, 0.85, 0.05, 0.1, 0.1, 0.8],
        "Transition probabilities between the motion models per interval, row by row. If a matrix "
        "has no generator (matrix logarithm), intervals are rounded to whole nominal ones.",
        (0.0, 1.0),
    )
    survival_probability: float = parameter(
        0.99, "Probability that a target survives an interval.", (SMALL, 1.0)
    )


@dataclass(frozen=True)
class Motion:
    """The parameters of a motion model."""

    model: str = parameter(
        "constant_velocity",
        "Motion model: nearly constant velocity, a coordinated turn with an estimated turn rate, "
        "or stationary. A class that is only stationary is tracked; see report_resting.",
        choices=tuple(MOTIONS),
    )
    noise_density: float = parameter(
        1.0,
        "Spectral density of the white acceleration, m^2/s^3; for stationary, of the white "
        "velocity, m^2/s.",
        POSITIVE,
    )
    turn_noise_density: float = parameter(
        1e-4,
        "Spectral density of the white turn acceleration, rad^2/s^3; for coordinated turns only.",
        (1e-15, INFINITY),
    )
    turn_time_constant_s: float = parameter(
        0.0,
        "Time constant with which the turn rate returns to zero, s: the usual length of a turn, "
        "which begins with a rate of the long run; 0 for a rate that does not return and begins "
        "at zero. For coordinated turns only.",
        NOT_NEGATIVE,
    )
    vertical_noise_density: float = parameter(
        1.0,
        "Spectral density of the white vertical acceleration, m^2/s^3; only with state: space.",
        POSITIVE,
    )


@dataclass(frozen=True)
class Birth:
    """The parameters of a birth term."""

    position: list[float] = parameter(
        [0.0, 0.0], "Mean position of births in the world frame, x and y, m.", length=2
    )
    velocity: list[float] = parameter(
        [0.0, 0.0], "Mean velocity of births in the world frame, x and y, m/s.", length=2
    )
    std: list[float] = parameter(
        [200.0, 40.0, 1e-3],
        "Standard deviations of a birth's position and velocity per axis, m and m/s, and of its "
        "turn rate, rad/s.",
        POSITIVE,
        length=3,
    )
    rates: list[float] = parameter(
        [0.005, 0.005],
        "Expected births per interval, one number per class.",
        (0.0, 1e3),
        mutable=True,
    )


class Parts(NamedTuple):
    """The parameters of the tracker and of its parts, by name."""

    tracking: Tracking
    sensors: dict[str, SensorParameters]
    classes: dict[str, TargetClass]
    motions: dict[str, Motion]
    births: dict[str, Birth]
    # Receivers of self-reports, which are listed among the sensors.
    receivers: dict[str, SensorParameters]


# Defaults that follow from the value of another parameter.
IMPLIED: dict[tuple[str, str], dict[str, Any]] = {
    **{("engine", name): {"learn": [], "detection_births.rates": []} for name in PHD}
}
# Values of the usual names that differ from the defaults of their group. The classes' bands are
# those of the reference scenario. The motions, with their mode matrix, were tuned on seeds from
# 9000 on of that scenario and of turning targets.
USUAL: dict[str, Any] = {
    "radar_1.position": [1000.0, 0.0],
    "class_0.snr_band_db": [30.0, 50.0],
    "class_1.snr_band_db": [10.0, 30.0],
    "calm.noise_density": 0.01,
    "ct.model": "coordinated_turn",
    "ct.turn_noise_density": 1e-5,
}
