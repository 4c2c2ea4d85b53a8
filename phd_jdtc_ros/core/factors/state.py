"""The factors of all sensors as one value, which the update uses and replaces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, TypeVar

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly
from ..association.evidence import OutOfGate, Paired, PairEvidence, pair_as_reported
from ..reports.model import Receiver
from ..reports.tables import Layer
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import Snapshot, from_snapshot, to_snapshot
from ..types import Detections
from ..types.clutter_raster import ClutterRaster
from .clutter.map import ClutterMap
from .clutter.raster import raster
from .factor import Factor, FactorT, Look, Targets
from .recent_looks import RecentLooks
from .transponder.pressure import Pressure
from .transponder.records import AttributeModel
from .transponder.transponders import Transponders

PriorT = TypeVar("PriorT", bound="Prior")
LOOKS = "recent_looks"  # Name of the looks in snapshots


class Prior(Targets, Protocol):
    """Targets before a report, with the gates of their hypotheses."""

    def gate(self, detections: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the gated pairs of rows and detections, with their log likelihoods."""

    def with_reacquired(self: PriorT, out_of_gate: OutOfGate) -> PriorT:
        """Return the prior with additional rows at the detections of targets out of their gates."""


@dataclass(frozen=True, eq=False)
class Factors(ReadOnly):
    """The factors of each sensor, by its name, in the order in which they see a report."""

    by_sensor: Mapping[str, tuple[Factor, ...]]  # In the configured order of the sensors
    # Identities and heights of targets; None if no sensor reports any.
    transponders: Transponders | None = None
    # Recent looks of all sensors; births at detections depend on what others have missed.
    looks: RecentLooks | None = None  # None if nothing depends on them
    # Number of values of single targets after those of ended targets were last dropped.
    entries_kept: int = 0
    reports: Layer | None = None  # The layer of self-reports; None without receivers

    @staticmethod
    def configured(
        by_sensor: Mapping[str, tuple[Factor, ...]], model: AttributeModel | None, remembers: bool
    ) -> Factors:
        """Return factors of which nothing has been learned.

        `model` is that of identities and heights; None without any. `remembers` is whether births
        at detections depend on the looks of several sensors.
        """
        transponders = None if model is None else Transponders.of(model)
        looks = RecentLooks.of_none() if remembers and len(by_sensor) > 1 else None
        return Factors(by_sensor, transponders, looks)

    def expect(self, view: View) -> View:
        """Return a report with what the factors of its sensor expect of it."""
        for factor in _having("expect", self.by_sensor[view.sensor.name]):
            view = factor.expect(view)
        return view

    def given(self, view: View, targets: Targets) -> View:
        """Return a report with what the factors of its sensor expect, given its targets."""
        for factor in _having("given", self.by_sensor[view.sensor.name]):
            view = factor.given(view, targets)
        return view

    def gate(self, prior: PriorT, view: View) -> tuple[PriorT, Paired]:
        """Return the pairs of a report within the gates, and the targets that have them.

        Targets whose identities are shown by detections outside their gates get rows there.
        """
        transponders = self.transponders
        if transponders is None:
            return prior, pair_as_reported(prior.gate, view.detections)
        pairs = transponders.pair(prior.gate, prior, view)
        out_of_gate = transponders.out_of_gate(prior, pairs, view)
        if out_of_gate is None:
            return prior, pairs
        prior = prior.with_reacquired(out_of_gate)
        return prior, transponders.pair(prior.gate, prior, view)

    def evidence(self, prior: Prior, pairs: Paired, view: View) -> PairEvidence | None:
        """Return what the pairs show besides positions; None if nothing."""
        known = self.transponders
        return None if known is None else known.evidence(prior, pairs, view)

    def of_place(self, sensor: Sensor) -> View:
        """Return what is expected of a sensor at its pose, as a report without detections."""
        return self.expect(View.of(sensor, _nothing(len(sensor.components))))

    def after(self, look: Look) -> Factors:
        """Return the factors of all sensors, each with what it learns from a look of one."""
        own, by_sensor = look.view.sensor.name, {}
        for name, factors in self.by_sensor.items():
            hook, after = "learn" if name == own else "learn_from_others", list(factors)
            for index in _with(hook, tuple(map(type, factors))):
                after[index] = getattr(factors[index], hook)(look)
            by_sensor[name] = tuple(after)
        looks = self.looks and self.looks.after(look.view, list(by_sensor).index(own))
        transponders = self.transponders and self.transponders.after(look)
        return self.changed(by_sensor=by_sensor, looks=looks, transponders=transponders)

    def retuned(
        self,
        configured: Mapping[str, tuple[Factor, ...]],
        model: AttributeModel | None,
        receivers: tuple[Receiver, ...] = (),
        noise_density: float = 0.0,
    ) -> Factors:
        """Return newly configured factors with what these have learned.

        A factor that was not configured before begins as it is. `model` is that of identities and
        heights; `receivers` and `noise_density` are those of the layer of self-reports.
        """
        by_sensor = {}
        for name, factors in self.by_sensor.items():
            learned = {type(factor): factor for factor in factors}
            by_sensor[name] = tuple(
                factor.continuing(learned.get(type(factor), factor))
                for factor in configured.get(name, ())
            )
        transponders = self.transponders
        if transponders is not None and model is not None:
            transponders = transponders.changed(model=model)
        reports = self.reports and self.reports.changed(
            receivers=receivers, noise_density=noise_density
        )
        return self.changed(by_sensor=by_sensor, transponders=transponders, reports=reports)

    def find(self, name: str, kind: type[FactorT]) -> FactorT | None:
        """Return the factor of a kind of a sensor; None if it has none."""
        return next((each for each in self.by_sensor[name] if isinstance(each, kind)), None)

    @property
    def pressure(self) -> Pressure | None:
        """The difference of pressure altitudes from heights; None if no sensor reports these."""
        found = (self.find(name, Pressure) for name in self.by_sensor)
        return next((each for each in found if each is not None), None)

    def figures(self, sensors: Sequence[Sensor]) -> dict[str, float]:
        """Return what was learned about configured sensors, by dotted name."""
        found = {
            f"{sensor.name}.{name}": figure
            for sensor in sensors
            for factor in _having("figures", self.by_sensor[sensor.name])
            for name, figure in factor.figures(sensor).items()
        }
        return found if self.reports is None else found | self.reports.figures()

    def clutter_raster(self, sensors: Sequence[Sensor]) -> ClutterRaster | None:
        """Return the learned density of false detections; None if nothing was learned."""
        maps = {name: self.find(name, ClutterMap) for name in self.by_sensor}
        known = {name: clutter_map for name, clutter_map in maps.items() if clutter_map is not None}
        return raster(known, sensors)

    def of_living(self, labels: Iterable[IntArray]) -> Factors:
        """Return the factors without values of ended targets, once their number has doubled.

        `labels` has the labels of the living targets, in any number of arrays.
        """
        # Number of values of single targets below which those of targets that have ended are kept.
        few_entries = 256
        if self._entries <= 2 * self.entries_kept + few_entries:
            return self
        living = np.unique(np.concatenate(list(labels)))
        kept = self.changed(
            by_sensor={
                name: tuple([factor.of_living(living) for factor in factors])
                for name, factors in self.by_sensor.items()
            }
        )
        return kept.changed(entries_kept=kept._entries)

    def of_labels(self, labels: Sequence[IntArray], stamp_ns: int) -> Factors:
        """Return the factors with identities and heights of these labels only.

        Heights are kept that stamps from `stamp_ns` on need.
        """
        transponders = self.transponders and self.transponders.of_labels(labels, stamp_ns)
        reports = self.reports and self.reports.of_labels(stamp_ns)
        return self.changed(transponders=transponders, reports=reports)

    @property
    def _entries(self) -> int:
        every = self.by_sensor.values()
        return sum(each.entries for factors in every for each in _having("entries", factors))

    def to_snapshot(self, sensors: Sequence[Sensor], snapshot: Snapshot) -> None:
        """Store what was learned about these sensors."""
        for sensor in sensors:
            for factor in self.by_sensor[sensor.name]:
                if factor.NAME:
                    factor.to_snapshot(snapshot, f"{factor.NAME}.{sensor.name}", sensor)
        if self.looks is not None:
            to_snapshot(self.looks, snapshot, LOOKS)
        if self.transponders is not None:
            self.transponders.to_snapshot(snapshot)
        if self.reports is not None:
            self.reports.to_snapshot(snapshot)

    def restored(self, snapshot: Snapshot, sensors: Sequence[Sensor]) -> Factors:
        """Return these configured factors with what was stored.

        A stored value is dropped if the configuration sets it now.

        Raises
        ------
        ValueError
            If a value belongs to another sensor or place, or a tracker could not have stored it.
        """
        by_sensor, place = dict(self.by_sensor), {sensor.name: sensor for sensor in sensors}
        for name, factors in self.by_sensor.items():
            by_sensor[name] = tuple(_restored(factor, snapshot, place[name]) for factor in factors)
        for kind in {factor.NAME for factors in by_sensor.values() for factor in factors} - {""}:
            for other in sorted(snapshot.names_below(kind).difference(by_sensor)):
                listed = ", ".join(by_sensor)
                raise ValueError(f"{kind}: {other[:40]} given, must be a sensor: {listed}")
        looks = self.looks
        if looks is not None and snapshot.names_below(LOOKS):
            looks = from_snapshot(RecentLooks, snapshot, LOOKS, {"P": 6, "C": 2, "A": 4})
            if looks.sensor.max(initial=0) >= len(by_sensor):
                most = len(by_sensor)
                raise ValueError(f"{LOOKS}.sensor: must be below the number of sensors, {most}")
        transponders = self.transponders and self.transponders.restored(snapshot)
        reports = self.reports and self.reports.restored(snapshot)
        return self.changed(
            by_sensor=by_sensor, looks=looks, transponders=transponders, reports=reports
        )


def _having(hook: str, factors: tuple[Factor, ...]) -> Iterator[Factor]:
    """Return the factors that have a hook of their own."""
    return map(factors.__getitem__, _with(hook, tuple(map(type, factors))))


@cache
def _nothing(components: int) -> Detections:
    """Return no detections, of a sensor with a number of components."""
    return Detections(np.zeros((0, components)), None)


@cache
def _with(hook: str, kinds: tuple[type[Factor], ...]) -> tuple[int, ...]:
    """Return the indices of the kinds of factors that have a hook of their own."""
    return tuple(
        index
        for index, kind in enumerate(kinds)
        if getattr(kind, hook) is not getattr(Factor, hook)
    )


def _restored(factor: Factor, snapshot: Snapshot, sensor: Sensor) -> Factor:
    name = f"{factor.NAME}.{sensor.name}"
    if not factor.NAME or not snapshot.names_below(name):
        return factor
    return factor.restored(snapshot, name, sensor)
