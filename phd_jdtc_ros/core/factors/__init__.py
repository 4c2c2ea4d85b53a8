"""Assumptions about the world, one file each, with one interface (`factor`).

=====================  =====================================================================
`sectors`              a target is seen once in a pass of a turning antenna
`correlated_misses`    a target that was missed is probably missed again
`detection`            the learned detection probability, by place
`noise`                the learned noise of measurements
`outliers`             measurements with a larger noise
`clutter.rate`         the learned rate of uniform false detections, and bursts of them
`clutter.ranges`       the law of false detections over range, given or learned
`clutter.map`          places with false detections
`clutter.amplitude`    the learned law of the amplitudes of false detections
`multipath`            false detections behind targets
`limit`                the number of detections that one update can use
`transponder`          identities and heights of targets, which replies show
=====================  =====================================================================

`state` has the factors of all sensors as one value. It also has `transponder` and `recent_looks`,
what the sensors have looked at, which are of no single sensor and therefore no `Factor`. `prior` is
the prior of a configured value, and `loops` has compiled functions, which only the engine loads. A
new assumption is a new file here, and a row in `configuration.sensor_models`; the model of
transponders is made in `configuration.models`.
"""

from .clutter.amplitude import Learned
from .clutter.grid import GroundGrid, PolarGrid
from .clutter.map import ClutterMap
from .clutter.ranges import ClutterRanges
from .clutter.rate import START_RATE, Bursts, ClutterRate
from .correlated_misses import MOST as MOST_CORRELATION
from .correlated_misses import CorrelatedMisses
from .detection import Detection
from .factor import Factor
from .limit import Limit
from .multipath import Multipath
from .noise import Noise
from .outliers import Outliers
from .sectors import Sectors
from .transponder import AttributeModel, Pressure

__all__ = [
    "MOST_CORRELATION",
    "START_RATE",
    "AttributeModel",
    "Bursts",
    "ClutterMap",
    "ClutterRanges",
    "ClutterRate",
    "CorrelatedMisses",
    "Detection",
    "Factor",
    "GroundGrid",
    "Learned",
    "Limit",
    "Multipath",
    "Noise",
    "Outliers",
    "PolarGrid",
    "Pressure",
    "Sectors",
]
