"""Records of runs, small and known, that several test modules share."""

from dataclasses import replace

import numpy as np

from phd_jdtc_ros.core.state_space import PLANAR, X, Y
from phd_jdtc_ros.core.types import Estimates, Truth
from phd_jdtc_ros.report.record import RadarPlots, RadarSite, Record

START_NS = 1_700_000_000_000_000_000
SCANS = 12
# Ratio of the lengths of a run at short ranges to the usual ones.
SHORT = 0.01
RADARS = (RadarSite("radar_1", (0.0, 0.0)),)


def stamp_ns(scan):
    return START_NS + scan * 6_000_000_000


def states(scan, classes):
    """One target a class, side by side, moving east."""
    state = np.zeros((classes, len(PLANAR)))
    state[:, X] = 300.0 * scan
    state[:, Y] = 2000.0 * np.arange(classes)
    return state


def truth_of(scan, classes):
    return Truth(stamp_ns(scan), states(scan, classes), 1 + np.arange(classes), np.arange(classes))


def estimates_of(scan, classes, lag, count=None):
    count = classes if count is None else count
    return Estimates(
        stamp_ns=stamp_ns(scan),
        lag=lag,
        state=states(scan, classes)[:count] + 40.0,
        covariance=np.tile(np.diag([900.0, 1.0, 400.0, 1.0, 1e-6]), (count, 1, 1)),
        weight=np.ones(count),
        class_probability=np.eye(classes)[:count],
        class_id=np.arange(count),
        track_id=np.zeros(count),
    )


def plot_of(scan, classes):
    position = np.concatenate([states(scan, classes)[:, [X, Y]], [[-5e3, 4e3]]])
    return RadarPlots(stamp_ns(scan), "radar_1", position, np.r_[np.full(classes, 200.0), 3.8])


def record_of(classes=2, **parts):
    everything = {
        "truth": tuple(truth_of(k, classes) for k in range(SCANS)),
        "plots": tuple(plot_of(k, classes) for k in range(SCANS)),
        "filtered": tuple(estimates_of(k, classes, 0, classes - k % 2) for k in range(SCANS)),
        "smoothed": tuple(estimates_of(k, classes, 5) for k in range(SCANS)),
    }
    return Record(**{**everything, **parts}, classes=classes, step_ms=np.zeros(0), radars=RADARS)


def shrunk(record):
    """Return a record whose places are `SHORT` times as far apart."""

    def smaller(entry):
        changed = {"state": entry.state * SHORT}
        if isinstance(entry, Estimates):
            changed["covariance"] = entry.covariance * SHORT**2
        return replace(entry, **changed)

    return replace(
        record,
        truth=tuple(map(smaller, record.truth)),
        filtered=tuple(map(smaller, record.filtered)),
        smoothed=tuple(map(smaller, record.smoothed)),
        plots=tuple(replace(plot, position=plot.position * SHORT) for plot in record.plots),
    )


def without_amplitudes(record):
    """Return a record of radars that report no amplitudes."""
    return replace(
        record,
        plots=tuple(replace(p, amplitude=np.full(len(p.position), np.nan)) for p in record.plots),
    )
