"""Faults of a turning radar: in the optional fields of its detections, and in its sectors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros.core.arrays import FloatArray

from ..harness import scans
from ..harness.figures import Found, measures, wrong_counts
from ..harness.radars import Radars
from ..harness.rig import Rig, options

ROTATION_S, SECTORS = 4.0, 16
# The antenna is slower in the revolutions after this one.
SLOWER_AFTER, SLOWER = 14, 1.15
WARM_UP, REVOLUTIONS = 5, 20
# East and north of the target and its velocity, m and m/s; its height.
PLACE, VELOCITY, HEIGHT = np.array([9e3, 6e3]), np.array([-100.0, 60.0]), 2000.0
CLUTTER_PER_SECTOR = 3
# Largest distance of an estimate from the target, m.
NEAR_M = 250.0
PARAMETERS = {
    "sensors": "[radar_1]",
    "interval_s": ROTATION_S,
    "lag": 2,
    "classes": "[aircraft]",
    "motions": "[cv]",
    "births": "[]",
    "detection_births.rates": "[0.1]",
    "detection_births.std": [100.0],
    "spawn.rate": 0.0,
    "aircraft.motions": "[cv]",
    "aircraft.mode_transition": "[1.0]",
    "aircraft.snr_band_db": "[10.0, 30.0]",
    "cv.noise_density": 2.0,
    "radar_1.position": "[0.0, 0.0]",
    "radar_1.fields.amplitude": "''",
    "radar_1.fields.time": "time",
    "radar_1.fields.sector": "sector",
    "radar_1.fields.height": "height",
    "radar_1.fields.range_std": "deviation",
    "radar_1.fields.range_rate": "speed",
    "radar_1.range_rate_std": 2.0,
    "radar_1.range_rate_ambiguity": 400.0,
    "radar_1.rotation_s": ROTATION_S,
    "radar_1.sectors": SECTORS,
    "radar_1.detection_probability": 0.95,
    "radar_1.range_std": 30.0,
    "radar_1.azimuth_std_deg": 0.1,
    "radar_1.max_range": 30e3,
    "radar_1.clutter_max_range": 30e3,
    "radar_1.clutter_rate": float(CLUTTER_PER_SECTOR * SECTORS),
}
Columns = dict[str, FloatArray]
Change = Callable[[Columns], None]


@dataclass(frozen=True)
class Fault:
    """A faulty cloud of a sector."""

    name: str
    counted: str  # Key in the diagnostics, empty if nothing is to be counted
    change: Change  # Spoils the columns of a good cloud, except the target's detection
    count: int = CLUTTER_PER_SECTOR


def _values(name: str, value: float) -> Change:
    """Return a change of the clutter's values; the target comes last."""

    def change(columns: Columns) -> None:
        columns[name][:CLUTTER_PER_SECTOR] = value

    return change


def _all(name: str, value: Callable[[FloatArray], FloatArray]) -> Change:
    def change(columns: Columns) -> None:
        columns[name] = value(columns[name])

    return change


def _reverse(columns: Columns) -> None:
    columns.update({name: column[::-1] for name, column in columns.items()})


def _without(name: str) -> Change:
    def change(columns: Columns) -> None:
        del columns[name]

    return change


def faults() -> list[Fault]:
    """Return all faults that a cloud may have."""
    return [
        Fault("time beyond the revolution", "dropped_time", _values("time", 50.0)),
        Fault("time before the revolution", "dropped_time", _values("time", -50.0)),
        Fault("time NaN", "dropped_time", _values("time", math.nan)),
        Fault("time infinite", "dropped_time", _values("time", math.inf)),
        Fault("times not in order", "", _reverse),
        Fault("times of the revolution before", "detections_late", _values("time", -ROTATION_S)),
        Fault("no time", "time_missing", _without("time"), 1),
        Fault("height 1e9", "dropped_height", _values("height", 1e9)),
        Fault("height -1e9", "dropped_height", _values("height", -1e9)),
        Fault("height above the range", "dropped_height", _values("height", 29e3)),
        Fault("height NaN", "heights_unknown", _values("height", math.nan)),
        Fault("no height", "height_missing", _without("height"), 1),
        Fault("deviation 0", "deviations_unusable", _values("deviation", 0.0)),
        Fault("deviation negative", "deviations_unusable", _values("deviation", -1.0)),
        Fault("deviation absurd", "deviations_unusable", _values("deviation", 1e30)),
        Fault("deviation unknown", "", _values("deviation", math.nan)),
        Fault("range rate infinite", "range_rates_unusable", _values("speed", math.inf)),
        Fault("range rate absurd", "range_rates_unusable", _values("speed", -1e30)),
        Fault("range rate ambiguous", "range_rates_beyond_ambiguity", _values("speed", 900.0)),
        Fault("range rate unknown", "", _values("speed", math.nan)),
        Fault("no range rate", "range_rate_missing", _without("speed"), 1),
        Fault("sector NaN", "sectors_unusable", _all("sector", lambda own: own * math.nan), 1),
        Fault("sector 99", "sectors_unusable", _all("sector", lambda own: 0.0 * own + 99.0), 1),
        Fault("two sectors", "sectors_unusable", _values("sector", 77.0), 1),
        Fault(
            "sector of the other side",
            "sector_numbers_wrong",
            _all("sector", lambda own: (own + SECTORS // 2) % SECTORS),
            1,
        ),
    ]


@dataclass
class Antenna:
    """Makes the clouds of one sector after the other."""

    rng: np.random.Generator
    time_s: float = 0.0
    passed: int = 0

    def next(self, change: Change | None = None) -> PointCloud2:
        """Return the cloud of the next sector."""
        part = self.passed % SECTORS
        slower = SLOWER if self.passed // SECTORS > SLOWER_AFTER else 1.0
        length_s = slower * ROTATION_S / SECTORS
        share = np.sort(self.rng.uniform(0.0, 1.0, CLUTTER_PER_SECTOR))
        width = 2.0 * np.pi / SECTORS
        azimuth, time_s = width * (part + share), self.time_s + length_s * share
        slant = self.rng.uniform(5e3, 28e3, CLUTTER_PER_SECTOR)
        place = PLACE + VELOCITY * self.time_s
        speed = np.linspace(-150.0, 150.0, CLUTTER_PER_SECTOR)
        target = float(np.mod(np.arctan2(place[1], place[0]), 2.0 * np.pi)) / width - part
        if 0.0 <= target < 1.0:
            azimuth = np.append(azimuth, width * (part + target))
            time_s = np.append(time_s, self.time_s + length_s * target)
            speed = np.append(speed, float(place @ VELOCITY) / math.hypot(*place))
            slant = np.append(slant, math.hypot(*place, HEIGHT) + 30.0 * self.rng.standard_normal())
        self.time_s += length_s
        self.passed += 1
        columns = {
            "range": slant,
            "azimuth": azimuth,
            "time": time_s - self.time_s,
            "sector": np.full(len(slant), float(part)),
            "height": np.full(len(slant), HEIGHT),
            "deviation": np.full(len(slant), 30.0),
            "speed": speed,
        }
        if change is not None:
            change(columns)
        stamp_ns = scans.START_NS + round(self.time_s * 1e9)
        return point_cloud.encode(stamp_ns, "radar_1", columns)


@measures(
    "faults of a turning radar",
    "0 exits, 0 NaN, every one counted, the target tracked all the time",
)
def measure() -> Found:
    """Send every fault in a sector of its own between valid ones."""
    with Rig() as rig:
        tracker, radars = rig.tracking(*options(PARAMETERS), radars=1)
        antenna = Antenna(np.random.default_rng(1))
        wanted, lost, away = Counter[str](), [], []
        left = faults()
        for sector in range(REVOLUTIONS * SECTORS):
            fault = left.pop(0) if sector > WARM_UP * SECTORS and sector % 7 == 0 and left else None
            name = "valid" if fault is None else fault.name
            if sector == 12 * SECTORS:
                antenna.next()  # It is not sent
                wanted["clouds_missing"] += 1
            cloud = antenna.next(None if fault is None else fault.change)
            answered = send(radars, cloud)
            if sector == 13 * SECTORS:
                cloud.header.stamp.nanosec += 1
                answered &= send(radars, cloud)
                wanted["sectors_repeated"] += 1
            lost += [] if answered else [name]
            if fault is not None:
                wanted[fault.counted] += fault.count
            if sector > WARM_UP * SECTORS:
                away.append(how_far(radars, antenna.time_s))
            if not tracker.alive:
                raise RuntimeError(f"{name}: the tracker ended:\n{tracker.text[-2000:]}")
        counted = radars.values("radar_1")
        not_finite = radars.not_finite
    del wanted[""]
    found, wrong, said = wrong_counts(wanted, counted)
    tracked = float(np.mean(np.array(away) < NEAR_M))
    text = (
        f"0 exits, {not_finite} with NaN, {len(lost)} clouds lost, {len(faults()) + 2} faults; "
        f"{said}; the target is within {NEAR_M:g} m in {100.0 * tracked:.1f} % of the estimates"
    )
    reached = not (lost or wrong or not_finite) and tracked > 0.98
    return text, reached, {"counted": found, "wanted": dict(wanted), "tracked": tracked}


def send(radars: Radars, cloud: PointCloud2) -> bool:
    """Send a cloud and wait for an estimate; return whether one came."""
    before = len(radars.filtered)
    radars.outputs[0].publish(cloud)
    return radars.wait_for_more(before)


def how_far(radars: Radars, time_s: float) -> float:
    """Return the distance of the latest estimates from the target, which has been seen so far."""
    return radars.nearest(lambda then_s: PLACE + VELOCITY * min(then_s, time_s))


@measures(
    "detection probabilities that are none",
    "1 and beyond refused with status 2; 0 starts, by the SNR bands",
)
def measure_refused() -> Found:
    """Start trackers with detection probabilities at and beyond their bounds."""
    found = {}
    name = "radar_1.detection_probability"
    with Rig() as rig:
        for value in (1.0, 1.5, -0.1):
            node = rig.start("tracker", "--ros-args", *options({**PARAMETERS, name: value}))
            status = node.process.wait(30.0)
            said = f"{name}: {value} given, must be a number from 0 to 0.999"
            found[str(value)] = status if said in node.text else f"{status}, not said why"
        rig.tracker(*options({**PARAMETERS, name: 0.0}))
    text = ", ".join(f"{value}: status {status}" for value, status in found.items())
    return f"{text}; 0 starts", set(found.values()) == {2}, found
