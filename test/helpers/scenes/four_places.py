"""Four targets that stay 50 km away, each in its own direction, and a radar that turns.

The radar reports slices of a revolution, every other one with a target in its middle, or whole
revolutions.
"""

import numpy as np
from sweep import ROTATION_S, configuration

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.tracks.common_stamp import Schedule
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan
from phd_jdtc_ros.core.window.fixed_lag import GaussianEngine
from phd_jdtc_ros.core.window.forward_filter import ForwardFilter

# To the east, north, west and south, metres.
PLACES = 50e3 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
SLICES = 2 * len(PLACES)
REVOLUTION_NS = round(ROTATION_S * 1e9)
SLICE_NS = REVOLUTION_NS // SLICES
CONFIG = configuration({"radar.sectors": SLICES})
MODEL = CONFIG.model
(RADAR,) = MODEL.radars
NONE = np.zeros((0, 2))
EVERY = range(len(PLACES))


def measured(targets):
    """Return what the radar measures of targets, without noise."""
    state = np.zeros((len(targets), 5))
    state[:, [0, 2]] = PLACES[list(targets)]
    return RADAR.measure(state)


def slice_of(index, targets=EVERY):
    """Return the scan of a slice of a revolution, with a detection of its target, if any."""
    coverage = Coverage((index % SLICES - 0.5) * FULL_TURN / SLICES, FULL_TURN / SLICES)
    seen = [target for target in targets if index % SLICES == 2 * target]
    return Scan((index + 1) * SLICE_NS, (Detections(measured(seen), None, coverage=coverage),))


def revolution_of(index, targets=EVERY):
    """Return the scan of a whole revolution, as often as slices."""
    return Scan((index + 1) * SLICE_NS, (Detections(measured(targets), None),))


def rule(threshold):
    """Return the rule of one threshold of the existence probability."""
    return rule_of(MODEL, True, confirm=threshold, delete=threshold)


def engine(lag=SLICES, threshold=0.5, period_ns=0):
    """Return an engine for these targets; `lag` is a number of stamps, or a `Lag`."""
    forward = ForwardFilter(MODEL, CONFIG.bounds)
    lag = lag if isinstance(lag, Lag) else Lag(lag)
    return GaussianEngine(forward, lag, Schedule(period_ns), rule(threshold))
