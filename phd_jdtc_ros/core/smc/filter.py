"""The forward filter (Sec. IV-C, Steps 1 to 3): predict, update with every radar, resample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..snapshot import Snapshot
from ..types import Scan
from ..window.entries import Current, Entry
from ..window.forward_filter import Filtered, ForwardFilter
from ..window.swept import partition_swept
from ..window.update import update_scan
from .correction import Corrector
from .kernel import backward_kernel
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import Aged, ParticleSet
from .prediction import predict
from .proposals import birth_newborns
from .proposals.detected_newborns import redraw_velocities
from .proposals.detections_in_plane import places
from .resampling import ParticleBudget, resample
from .update import ParticleSteps

# Second word of the seed. It makes the filter's random stream independent of all others; with a
# shared stream, a simulation of the same seed would be correlated with the filter.
FILTER_STREAM = 2


@dataclass
class ParticleFilter(ForwardFilter[ParticleSet, Transition]):
    """The filter over scans; keeps the sets that later scans continue and the random generator.

    Parameters
    ----------
    done : callable
        See `ForwardFilter`.
    """

    corrector: Corrector
    budget: ParticleBudget
    seed: int
    _rng: np.random.Generator = field(init=False, repr=False)

    def reset(self) -> None:
        """Return to the initial state; the random generator starts from the seed again."""
        super().reset()
        self._rng = np.random.default_rng([self.seed, FILTER_STREAM])

    def step(self, scan: Scan, linked: bool) -> Filtered[ParticleSet, Transition]:
        """Predict, update with every radar and resample; if `linked`, build the backward kernel.

        Velocities of newborn targets in the earlier sets may be redrawn, see `detected_newborns`.

        Notes
        -----
        Sec. IV-C, Steps 1 to 3, and the kernel of Step 4.
        """
        model, corrector, index, rng = self.model, self.corrector, self._scan_index, self._rng
        dt = self._interval(scan)
        touched, others = partition_swept(self.current, scan, model, corrector.labelled)
        seen = places(scan, model)
        if corrector.labelled:
            before = touched
            touched = redraw_velocities(before, scan.stamp_ns, seen, model, rng)
            # Rows outside the sector keep referring to the redrawn set.
            drawn = {id(old.entry): new.entry for old, new in zip(before, touched, strict=True)}
            others = [Current(drawn.get(id(rows.entry), rows.entry), rows.rows) for rows in others]
        budget = self.budget.beside(sum(rows.entry.stored.copies(rows.rows) for rows in others))
        earlier = [
            Aged(rows.stored, self._since(rows.entry.stamp_ns, scan.stamp_ns)) for rows in touched
        ]
        births = self._births(scan)
        predicted = predict(earlier, births, seen, model, corrector, budget, index, rng)
        self.done("predict")
        steps = ParticleSteps(model, corrector, rng)
        known = self.attributes if corrector.labelled else None
        found = update_scan(predicted, scan, steps, dt, index, self.clutter, known)
        updated = found.rows
        self.done("update")
        young_from = index if corrector.labelled else None
        stored = resample(updated, model.modes, budget, rng, young_from)
        if corrector.labelled:
            stored = birth_newborns.redraw_velocities(stored, scan, model, index, rng)
        self.done("resample")
        link = None
        if linked and earlier:
            link = backward_kernel.build_joint(earlier, stored, model, corrector, found.newborns)
            self.done("transition")
        sources = tuple(rows.source for rows in touched)
        entry = Entry(scan.stamp_ns, stored, sources, link)
        self._keep(entry, others)
        return Filtered(updated, entry, tuple(rows.entry for rows in touched))

    @property
    def stored(self) -> ParticleSet:
        """The set of the last scan; empty before the first."""
        if not self.current:
            return ParticleSet.empty(len(self.model.modes.space))
        return self.current[-1].entry.stored

    def save_state(self) -> dict[str, Any]:
        """Return the filter's state; see `ForwardFilter.save_state`."""
        return {**super().save_state(), "rng": self._rng.bit_generator.state}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Return to a saved state."""
        super().load_state(state)
        self._rng.bit_generator.state = state["rng"]

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the filter's state, except for the sets themselves, in a snapshot."""
        super().to_snapshot(snapshot)
        snapshot.facts["filter.rng"] = self._rng.bit_generator.state

    def from_snapshot(self, snapshot: Snapshot, entries: Mapping[int, ParticleEntry]) -> None:
        """Restore the filter's state from a snapshot; see `ForwardFilter.from_snapshot`."""
        super().from_snapshot(snapshot, entries)
        self._rng.bit_generator.state = snapshot.facts["filter.rng"]
