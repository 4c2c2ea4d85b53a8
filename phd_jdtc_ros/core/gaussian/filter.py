"""The forward filter: predict, update with every radar, reduce."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..types import Scan
from ..window.entries import Entry
from ..window.forward_filter import Filtered, ForwardFilter
from ..window.swept import partition_swept
from ..window.update import update_scan
from .bounds import Bounds
from .dynamics import Dynamics
from .mixture import Mixture
from .new_targets import births, spawn
from .prediction import AgedMixture, survivors
from .reduction import Branched, reduce_hypotheses
from .smoothing.lineages import Link
from .update import GaussianSteps


@dataclass
class GaussianFilter(ForwardFilter[Mixture, Link]):
    """The filter over scans; keeps the mixtures that later scans continue."""

    bounds: Bounds
    # Number of clusters associated approximately in the last step.
    approximate: int = field(init=False, default=0)
    floored: int = field(init=False, default=0)
    _dynamics: Dynamics | None = field(init=False, default=None, repr=False)

    @property
    def dynamics(self) -> Dynamics:
        """The motion modes and cells of the model in use."""
        if self._dynamics is None or self._dynamics.model is not self.model:
            self._dynamics = Dynamics(self.model)
        return self._dynamics

    def step(self, scan: Scan, linked: bool) -> Filtered[Mixture, Link]:
        """Predict, update with every radar and reduce; see `ForwardFilter.step`."""
        dynamics, index = self.dynamics, self._scan_index
        dt = self._interval(scan)
        swept, others = partition_swept(self.unswept, scan, self.model, labelled=True)
        aged = [
            AgedMixture(rows.stored, self._since(rows.entry.stamp_ns, scan.stamp_ns))
            for rows in swept
        ]
        parts: list[Mixture] = []
        moves = None
        if aged:
            *parts, moves = survivors(aged, dynamics)
        if born := self._births(scan):
            parts.append(births(born, dynamics, index))
        if self.model.spawn.rate > 0.0:
            parts.append(spawn(aged, dynamics, index, self.bounds.least_existence))
        predicted = Mixture.concatenate(parts or [dynamics.nothing])
        self.on_stage_end("predict")
        parent = np.arange(len(predicted))
        parent[len(parts[0]) if aged else 0 :] = -1
        parts.clear()  # the update needs the memory
        branched = Branched(predicted, parent)
        steps = GaussianSteps(dynamics, self.bounds)
        updated = update_scan(branched, scan, steps, dt, index, self.sensors, self.attributes)
        self.approximate = updated.approximate
        self.on_stage_end("update")
        stored, ancestry, self.floored = reduce_hypotheses(updated.rows, self._bounds_of_newborn())
        self.on_stage_end("reduce")
        link = Link(moves, ancestry) if linked and moves is not None else None
        entry = Entry(scan.stamp_ns, stored, tuple(rows.source for rows in swept), link)
        self._keep(entry, others)
        return Filtered(stored, entry)

    def _bounds_of_newborn(self) -> Bounds:
        """Return bounds that do not drop every new target; see `least_newborn_mass`."""
        model = self.model
        if not model.detection_births.enabled:
            return self.bounds
        sensors = map(self.sensors.with_learned_values, model.radars)
        least = min(map(model.least_newborn_mass, sensors))
        if least >= model.detection_births.least_mass:
            return self.bounds
        return replace(self.bounds, least_existence=min(self.bounds.least_existence, least))
