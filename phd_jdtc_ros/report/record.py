"""The record of one run: truth, detections, estimates, and what was learned of the sensors."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.asterix.messages import CallSigns, call_sign_text
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.conflicts.model import Conflicts
from phd_jdtc_ros.core.factors.outliers import Outliers
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates, Truth
from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster
from phd_jdtc_ros.evaluation.comparison import ALL, PointSet, class_set
from phd_jdtc_ros.evaluation.run_scores import Evaluation


@dataclass(frozen=True)
class Sets:
    """The sets of a run: all classes together, and each class."""

    _GENERIC = re.compile(r"class_(\d+)")

    class_names: tuple[str, ...]  # Configured names

    @staticmethod
    def of(classes: int, class_names: Sequence[str] = ()) -> Sets:
        """Return the sets of `classes` classes; another number of names is ignored."""
        fitting = len(class_names) == classes
        return Sets(tuple(class_names) if fitting else tuple(map(class_set, range(classes))))

    @staticmethod
    def of_summary(summary: Mapping[str, Any]) -> Sets:
        """Return the sets of a run's figures, in the form of `metrics.json`."""
        keys = {key for source in SOURCES for key in summary.get(source) or {}} - {ALL}
        return Sets.of(len(keys), summary.get("class_names") or ())

    @property
    def one_class(self) -> bool:
        """Whether there is only one class, whose set equals the set of all targets."""
        return len(self.class_names) == 1

    @property
    def of_classes(self) -> list[str]:
        """The keys of the shown classes' sets: none if there is only one class."""
        return [] if self.one_class else [class_set(k) for k in range(len(self.class_names))]

    @property
    def keys(self) -> list[str]:
        """The keys of the shown sets."""
        return [ALL, *self.of_classes]

    def class_title(self, class_id: int) -> str:
        """Return the title of a class, configured or not."""
        known = class_id < len(self.class_names)
        name = self.class_names[class_id] if known else class_set(class_id)
        found = self._GENERIC.fullmatch(name)
        return name if found is None else f"class {found[1]}"

    def title(self, key: str, everything: str = "all classes") -> str:
        """Return the title of a set; the set of all targets takes the title of an only class."""
        if key != ALL:
            return self.class_title(class_of(key))
        return self.class_title(0) if self.one_class else everything


def class_of(key: str) -> int:
    """Return the class id of a class's set."""
    return int(key.removeprefix("class_"))


class LearnedValue(NamedTuple):
    """One learned value of a sensor."""

    sensor: str
    quantity: str  # Name of the parameter, or of what has none
    given: float  # The value that is configured, or that learning starts from
    found: float  # The learned value
    std: float  # Standard deviation of the learned value
    unit: str  # Unit of the three numbers; empty for a probability


def sensor_changes(
    inputs: Iterable[SensorParameters], figures: Mapping[str, float]
) -> dict[str, str]:
    """Return the warnings about sensors that have changed, by sensor."""
    names = [radar.name for radar in inputs]
    texts = {name: anomalies.of_changes(anomalies.figures_of(name, figures)) for name in names}
    return {name: text for name, text in texts.items() if text is not None}


def learned_values(
    inputs: Iterable[SensorParameters], figures: Mapping[str, float]
) -> Iterator[LearnedValue]:
    """Yield the values that are learned of each sensor, by a step's `Factors.figures`."""
    for radar in inputs:
        quantity = "detection_probability"
        name = f"{radar.name}.{quantity}"
        if name in figures:
            given, std = figures[f"{name}_set"], figures[f"{name}_std"]
            yield LearnedValue(radar.name, quantity, given, figures[name], std, "")
        parameters = Counter(quantity for quantity, _ in radar.noise_parameters.values())
        for component, (quantity, unit) in radar.noise_parameters.items():
            name = f"{radar.name}.{component}_noise_ratio"
            if name in figures:
                given = getattr(radar, quantity)
                found, std = given * figures[name], given * figures[f"{name}_std"]
                of = f"{quantity} of {component}" if parameters[quantity] > 1 else quantity
                yield LearnedValue(radar.name, of, given, found, std, unit)
        if (name := f"{radar.name}.outlier_share") in figures:
            columns = Outliers.start, figures[name], figures[f"{name}_std"]
            yield LearnedValue(radar.name, "share of outliers", *columns, "")


@dataclass(frozen=True)
class RadarPlots:
    """The detections of one radar at one stamp, in the world frame."""

    stamp_ns: int
    radar: str
    position: FloatArray  # Metres, (M, 2)
    amplitude: FloatArray  # Linear envelope, (M,); NaN where the radar reports none
    # Position of a moving radar, metres; None for a stationary one.
    sensor: tuple[float, float] | None = None
    # Heights above the world's zero, metres, (M,); NaN where unknown. None if the radar reports
    # none.
    height: FloatArray | None = None


class AllPlots(NamedTuple):
    """The detections of all radars, report by report."""

    position: FloatArray  # Metres, (M, 2)
    amplitude: FloatArray  # (M,)

    @property
    def known(self) -> BoolArray:
        """Whether each amplitude can be shown on a logarithmic scale."""
        return np.isfinite(self.amplitude) & (self.amplitude > 0.0)


@dataclass(frozen=True)
class RadarSite:
    """The name of a radar, its position in the world frame and its antenna's height, metres."""

    name: str
    position: tuple[float, float]
    height: float = math.nan
    # Lowest and highest elevation of its field of view, radians; empty in the plane.
    elevations: tuple[float, ...] = ()


@dataclass(frozen=True)
class Record:
    """A run, each part ordered by stamp."""

    truth: tuple[Truth, ...]  # Empty if the truth is unknown
    plots: tuple[RadarPlots, ...]
    filtered: tuple[Estimates, ...]  # Empty if not recorded
    smoothed: tuple[Estimates, ...]  # Empty if not recorded
    classes: int
    step_ms: FloatArray  # CPU time of each step, milliseconds, (scans,); empty if not measured
    radars: tuple[RadarSite, ...] = ()  # The stationary radars
    # Damage of the bag, of which the run contains the intact part; None for an intact bag.
    damage: BagError | None = None
    class_names: tuple[str, ...] = ()  # Configured names; empty if unknown
    # Clutter map learned by the end of the run; None if not recorded.
    clutter: ClutterRaster | None = None
    # The world frame's map projection, None over a plane; and whether its place on the earth is
    # known, so that there are latitudes and longitudes.
    plane: Plane | None = None
    place_known: bool = True
    # Least speed of the targets that the tracker had to report, metres per second.
    least_speed: float = 0.0
    learned: tuple[LearnedValue, ...] = ()  # The sensors' learned values at the end of the run
    # How each sensor had changed at the end of the run, by name.
    changes: Mapping[str, str] = field(default_factory=dict)
    call_signs: CallSigns = field(default_factory=CallSigns)  # By address
    conflicts: tuple[Conflicts, ...] = ()  # Empty if not recorded
    zones: tuple[Zone, ...] = ()

    @cached_property
    def sets(self) -> Sets:
        """The sets of classes, with their names."""
        return Sets.of(self.classes, self.class_names)

    @cached_property
    def all_plots(self) -> AllPlots:
        """The detections of the run."""
        return AllPlots(
            concatenate_rows((plot.position for plot in self.plots), 2),
            concatenate_rows(plot.amplitude for plot in self.plots),
        )

    def of_source(self, source: str) -> tuple[Estimates, ...]:
        """Return the ``filtered`` or the ``smoothed`` estimates."""
        return {FILTERED: self.filtered, SMOOTHED: self.smoothed}[source]

    def call_sign_of(self, address: str) -> str:
        """Return the call sign of an address, hexadecimal; empty if unknown."""
        return call_sign_text(self.call_signs.of(int(address, 16))) if address else ""

    @property
    def class_fault(self) -> str | None:
        """Fault of the truth's classes; None if the tracker has all of them."""
        largest = max(
            (int(truth.class_id.max()) for truth in self.truth if len(truth.class_id)), default=-1
        )
        if largest < self.classes:
            return None
        return (
            f"the truth has class_id {largest}, and the tracker {self.classes} classes: targets "
            "of the others are scored in total only"
        )

    def evaluate(self, cutoff: float, order: float) -> Evaluation:
        """Return the scores of the run; `cutoff` in metres."""
        names = self.sets.class_names
        evaluation = Evaluation(
            self.classes, cutoff, order, class_names=names, least_speed=self.least_speed
        )
        for truth in self.truth:
            evaluation.add_truth(truth.stamp_ns, PointSet.of(truth))
        for source in SOURCES:
            for estimates in self.of_source(source):
                evaluation.add_estimates(source, estimates.stamp_ns, PointSet.of(estimates))
        return evaluation


def concatenate_rows(parts: Iterable[Any], *shape: int) -> FloatArray:
    """Return arrays joined end to end, rows of the given shape; empty if there are none."""
    return np.concatenate([np.zeros((0, *shape)), *parts])
