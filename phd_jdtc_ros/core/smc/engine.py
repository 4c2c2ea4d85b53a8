"""The particle engine: the filter, the backward smoother and the extraction of particle sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..snapshot import Snapshot
from ..types import Estimates
from ..window.forward_filter import Filtered
from ..window.set_smoother import SetSmoother
from . import snapshot
from .extraction import Extraction, estimates
from .filter import ParticleFilter
from .kernel.backward_kernel import ParticleEntry, Transition
from .particle_set import ParticleSet
from .smoother import DeathTerm, backward_pass

# Second word of the extraction's seed; `filter.FILTER_STREAM` is the filter's.
EXTRACTION_STREAM = 1


@dataclass
class ParticleEngine(SetSmoother[ParticleSet, Transition]):
    """Sequential Monte Carlo filter with a fixed-lag backward smoother over the general mode.

    The corrector of `forward` makes it a labelled multi-Bernoulli filter or a PHD filter. Sec.
    IV-C: Steps 1 to 3 in `forward`, Step 4 in `smoother`, Steps 5 and 6 in `extraction`.
    """

    STATE: ClassVar[tuple[str, ...]] = (*SetSmoother.STATE, "_rng")

    forward: ParticleFilter
    death_term: DeathTerm
    extraction: Extraction
    _rng: np.random.Generator = field(init=False, repr=False)

    def reset(self) -> None:
        """Return to the initial state; the random generators start from the seed again."""
        super().reset()
        # A separate generator keeps the filter's draws independent of the extraction.
        self._rng = np.random.default_rng([self.forward.seed, EXTRACTION_STREAM])

    def snapshot(self) -> Snapshot:
        """Return the engine's state; see `Engine.snapshot`."""
        stored = super().snapshot()
        stored.json_values["extraction.rng"] = self._rng.bit_generator.state
        return stored

    def _from_snapshot(self, stored: Snapshot) -> None:
        super()._from_snapshot(stored)
        self._rng.bit_generator.state = stored.json_values["extraction.rng"]

    def _extract(self, stored: ParticleSet, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        modes = self.forward.model.modes
        groups = self.extraction(stored, modes, threshold, self._rng)
        return estimates(stored, modes, stamp_ns, lag, groups)

    def _backward(self, window: Sequence[ParticleEntry]) -> Sequence[ParticleSet]:
        return list(backward_pass(window, self.death_term))

    def _figures(self, step: Filtered[ParticleSet, Transition]) -> Mapping[str, float]:
        return {
            "particles": len(step.entry.stored),
            "effective_sample_size": step.entry.stored.effective_sample_size,
            "effective_share": step.updated.effective_share,
            "orphans": step.entry.link.orphans if step.entry.link else 0,
        }

    def _entry_to_snapshot(self, entry: ParticleEntry, stored: Snapshot, name: str) -> None:
        snapshot.entry_to_snapshot(entry, stored, name)

    def _entry_from_snapshot(
        self, stored: Snapshot, name: str, earlier: Mapping[int, ParticleEntry]
    ) -> ParticleEntry:
        modes, most = self.forward.model.modes, self.forward.budget.most
        return snapshot.entry_from_snapshot(stored, name, earlier, modes, most)
