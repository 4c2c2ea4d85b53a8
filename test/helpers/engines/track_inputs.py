"""Scans and estimates for the states of tracks: by default two radars without detections."""

from dataclasses import replace

import estimate_sets
import numpy as np
from inner import resolve

from phd_jdtc_ros.core.tracks.coverage import missed_and_spread
from phd_jdtc_ros.core.types import Detections, Scan

# Without a memory of SNRs each track has a record of its misses.
MODEL = resolve({"amplitude": "band"}).model
# Covariance of a state that is known to a metre.
SHARP = np.diag([1.0, 1.0, 1.0, 1.0, 1e-6])


def scan_of(stamp_ns, model=MODEL):
    """Return a scan in which no radar detects anything."""
    sizes = (len(radar.noise_std) for radar in model.radars)
    empty = (Detections(np.zeros((0, size)), np.zeros(0)) for size in sizes)
    return Scan(stamp_ns, tuple(empty))


def views_of(model=MODEL):
    """Return what is expected of each sensor of a model that has learned nothing."""
    return model.expected(scan_of(0, model))


def estimates_of(stamp_ns, found, class_id=1, lag=0, model=MODEL):
    """Return estimates at 5 km of {track: existence probability}."""
    count, space = len(found), model.modes.space
    return estimate_sets.estimates(
        np.tile(space.state((5e3, 0.0), (0.0, 0.0), 0.0), (count, 1)),
        np.zeros((len(space), len(space))),
        np.array([*found.values()], dtype=float),
        stamp_ns=stamp_ns,
        lag=lag,
        class_probability=np.eye(len(model.modes.classes))[np.full(count, class_id)],
        class_id=np.full(count, class_id),
        track_id=np.array([*found], dtype=np.int64),
    )


def missed_by(scan, model=MODEL):
    """Return the probability that no radar of a scan detects a target of the second class."""
    (missed,), _ = missed_and_spread(estimates_of(0, {1: 1.0}), scan, model, views_of(model))
    return float(missed)


def spread_by(covariance, model=MODEL):
    """Return what `missed_and_spread` says of a density of the second class."""
    found = estimates_of(0, {1: 1.0}, model=model).changed(covariance=np.array([covariance]))
    (missed,), (spread,) = missed_and_spread(found, scan_of(0), model, views_of(model))
    return missed, spread


def beyond(model, range_m=100.0):
    """Return the model with radars that see too near to see a target, so that it is not missed."""
    radars = [replace(r, visibility=replace(r.visibility, max_range=range_m)) for r in model.radars]
    return replace(model, radars=tuple(radars))
