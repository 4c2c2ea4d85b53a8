"""The forward filter (Sec. IV-C, Steps 1 to 3): predict, update with every radar, resample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..snapshot import Snapshot
from ..types import Scan
from ..window.entries import Entry, UnsweptRows
from ..window.forward_filter import Filtered, ForwardFilter
from ..window.swept import partition_swept
from ..window.update import update_scan
from .correction import Corrector
from .kernel import backward_kernel
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import AgedParticles, ParticleSet
from .prediction import predict
from .proposals import birth_newborns
from .proposals.detected_newborns import redraw_velocities
from .proposals.detections_in_plane import scan_in_plane
from .resampling import ParticleBudget, resample
from .update import ParticleSteps

# Second word of the seed. It makes the filter's random stream independent of all others; with a
# shared stream, a simulation of the same seed would be correlated with the filter.
FILTER_STREAM = 2


@dataclass
class ParticleFilter(ForwardFilter[ParticleSet, Transition]):
    """The filter over scans; keeps the sets that later scans continue and the random generator."""

    STATE: ClassVar[tuple[str, ...]] = (*ForwardFilter.STATE, "_rng")

    corrector: Corrector
    budget: ParticleBudget
    seed: int
    _rng: np.random.Generator = field(init=False, repr=False)

    @property
    def labelled(self) -> bool:
        """Whether the rows of one label are at most one target."""
        return self.corrector.labelled

    def reset(self) -> None:
        """Return to the initial state; the random generator starts from the seed again."""
        super().reset()
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])

    def step(self, scan: Scan, linked: bool) -> Filtered[ParticleSet, Transition]:
        """Predict, update with every radar and resample; if `linked`, build the backward kernel.

        Velocities of newborn targets in the earlier sets may be redrawn, see `detected_newborns`.
        Sec. IV-C, Steps 1 to 3, and the kernel of Step 4.
        """
        model, corrector, index, rng = self.model, self.corrector, self._scan_index, self._rng
        dt = self._interval(scan)
        swept, remaining = partition_swept(self.unswept, scan, model, corrector.labelled)
        detections = scan_in_plane(scan, model)
        if corrector.labelled:
            filtered_rows = swept
            swept = redraw_velocities(filtered_rows, scan.stamp_ns, detections, model, rng)
            # Rows outside the sector keep referring to the redrawn set.
            redrawn = {
                id(old.entry): new.entry for old, new in zip(filtered_rows, swept, strict=True)
            }
            remaining = [
                UnsweptRows(redrawn.get(id(rows.entry), rows.entry), rows.rows)
                for rows in remaining
            ]
        budget = self.budget.remaining(
            sum(rows.entry.stored.copies(rows.rows) for rows in remaining)
        )
        aged = [
            AgedParticles(rows.stored, self._since(rows.entry.stamp_ns, scan.stamp_ns))
            for rows in swept
        ]
        births = self._births(scan)
        predicted = predict(aged, births, detections, model, corrector, budget, index, rng)
        self.on_stage_end("predict")
        steps = ParticleSteps(model, corrector, rng)
        attributes = self.attributes if self.labelled else None
        updated_scan = update_scan(predicted, scan, steps, dt, index, self.sensors, attributes)
        updated = updated_scan.rows
        self.on_stage_end("update")
        young_from = index if corrector.labelled else None
        stored = resample(updated, model.modes, budget, rng, young_from)
        if corrector.labelled:
            stored = birth_newborns.redraw_velocities(stored, scan, model, index, rng)
        self.on_stage_end("resample")
        link = None
        if linked and aged:
            link = backward_kernel.build_joint(
                aged, stored, model, corrector, updated_scan.newborns
            )
            self.on_stage_end("transition")
        sources = tuple(rows.source for rows in swept)
        entry = Entry(scan.stamp_ns, stored, sources, link)
        self._keep(entry, remaining)
        return Filtered(updated, entry, tuple(rows.entry for rows in swept))

    @property
    def stored(self) -> ParticleSet:
        """The set of the last scan; empty before the first."""
        if not self.unswept:
            return ParticleSet.empty(len(self.model.modes.space))
        return self.unswept[-1].entry.stored

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        super().to_snapshot(snapshot)
        snapshot.json_values["filter.rng"] = self._rng.bit_generator.state

    def from_snapshot(self, snapshot: Snapshot, entries: Mapping[int, ParticleEntry]) -> None:
        """Restore the filter's state from a snapshot; see `ForwardFilter.from_snapshot`."""
        super().from_snapshot(snapshot, entries)
        self._rng.bit_generator.state = snapshot.json_values["filter.rng"]
