"""A turning radar and its detections of targets, sector by sector."""

import inner
import numpy as np

from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan

ROTATION_S = 4.0
SECTORS = 16
START_NS = 1_000_000_000_000
GIVEN = {
    "sensors": ["radar"],
    "classes": ["aircraft"],
    "motions": ["cv", "ct"],
    "births": [],
    "interval_s": ROTATION_S,
    "amplitude": "none",
    "radar.rotation_s": ROTATION_S,
    "radar.sectors": SECTORS,
    "radar.range_std": 40.0,
    "radar.azimuth_std_deg": 0.1,
    "radar.max_range": 100e3,
    "radar.clutter_rate": 1.0,
    "radar.clutter_max_range": 100e3,
    "radar.detection_probability": 0.95,
    "detection_births.rates": [0.5],
    "detection_births.std": [150.0],
    "detection_births.least_probability": 5e-3,
    "spawn.rate": 0.0,
    "aircraft.motions": ["cv", "ct"],
    "aircraft.mode_transition": [0.95, 0.05, 0.1, 0.9],
    "aircraft.survival_probability": 0.999,
    "cv.noise_density": 3.0,
    "ct.model": "coordinated_turn",
    "ct.noise_density": 50.0,
    "ct.turn_noise_density": 1e-4,
}
# Position and velocity at the start; one flies along the edge of a sector, and one crosses edges.
TARGETS = np.array(
    [
        [30e3, 10e3, -150.0, 60.0],
        [-20e3, 0.0, -200.0, 0.0],
        [-10e3, -30e3, 220.0, 30.0],
        [15e3, -40e3, -40.0, 180.0],
    ]
)


def configuration(given=None):
    return inner.resolve({**GIVEN, **(given or {})})


def position_at(seconds):
    """Return the targets' positions, shape (T, 2)."""
    return TARGETS[:, :2] + seconds * TARGETS[:, 2:]


def azimuth_at(seconds):
    """Return where the antenna looks; it turns clockwise."""
    return -FULL_TURN * seconds / ROTATION_S


def plots(revolutions, seed, missed=0.0):
    """Return (time, range, azimuth) of every plot, by ascending time."""
    rng = np.random.default_rng(seed)
    found = []
    for revolution in range(revolutions):
        for target in range(len(TARGETS)):
            seconds = (revolution + 0.5) * ROTATION_S
            for _ in range(5):
                x, y = position_at(seconds)[target]
                phase = np.mod(-np.arctan2(y, x), FULL_TURN) / FULL_TURN
                seconds = (revolution + phase) * ROTATION_S
            if rng.random() >= missed:
                distance = np.hypot(x, y) + 40.0 * rng.standard_normal()
                azimuth = np.arctan2(y, x) + np.radians(0.1) * rng.standard_normal()
                found.append((seconds, distance, azimuth))
    return np.array(sorted(found)).reshape(-1, 3)


def scans(revolutions, seed=0, missed=0.0, sectors=SECTORS):
    """Return the scans of some revolutions, one per sector, stamped in the middle of each."""
    table = plots(revolutions, seed, missed)
    length = ROTATION_S / sectors
    found = []
    for index in range(revolutions * sectors):
        begin, middle, end = (length * (index + part) for part in (0.0, 0.5, 1.0))
        inside = table[(table[:, 0] >= begin) & (table[:, 0] < end)]
        detections = Detections(
            inside[:, 1:],
            None,
            inside[:, 0] - middle,
            coverage=Coverage(azimuth_at(end), FULL_TURN / sectors),
        )
        found.append(Scan(START_NS + round(middle * 1e9), (detections,)))
    return found


def sector_reports(revolutions, timed, seed=5, clutter=3):
    """Return (radar, stamp, detections, sector) of every sector, with some false ones in each."""
    table = plots(revolutions, seed)
    rng = np.random.default_rng(seed)
    length = ROTATION_S / SECTORS
    reports = []
    for index in range(revolutions * SECTORS):
        begin, end = length * index, length * (index + 1)
        inside = table[(table[:, 0] >= begin) & (table[:, 0] < end)]
        time_s = rng.uniform(begin, end, clutter)
        false = [time_s, rng.uniform(5e3, 90e3, clutter), azimuth_at(time_s)]
        found = np.concatenate([inside, np.stack(false, axis=1)])
        found = found[np.argsort(found[:, 0])]
        found[:, 2] = np.mod(found[:, 2] + np.pi, FULL_TURN) - np.pi
        detections = Detections(found[:, 1:], None, found[:, 0] - end if timed else None)
        number = SECTORS - 1 - index % SECTORS
        reports.append((0, START_NS + round(end * 1e9), detections, number))
    return reports


def seconds_of(stamp_ns):
    return (stamp_ns - START_NS) * 1e-9
