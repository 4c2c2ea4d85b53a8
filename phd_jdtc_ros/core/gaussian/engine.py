"""The Gaussian engine: the filter, the backward smoother and the extraction of mixtures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..snapshot import Snapshot
from ..types import Estimates
from ..window.fixed_lag import FixedLagEngine
from ..window.forward_filter import Filtered
from . import snapshot
from .extraction import extract
from .filter import GaussianFilter
from .mixture import Mixture
from .smoothing.lineages import Lineages, Link
from .smoothing.smoother import extract_at
from .snapshot import GaussianEntry


@dataclass
class GaussianEngine(FixedLagEngine[Mixture, Link]):
    """Gaussian mixtures of labelled targets with a fixed-lag backward smoother."""

    forward: GaussianFilter
    # Lineages of the window of the last step, which the next step extends.
    _lineages: Lineages = field(init=False, default_factory=Lineages, repr=False)

    def _extract(self, stored: Mixture, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        return extract(stored, self.forward.dynamics, stamp_ns, lag, threshold)

    def _smoothed_at(self, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        self._lineages.extend(self._window)
        around = self._lineages.smooth(stamp_ns, threshold)
        self.forward.on_stage_end("backward")
        return extract_at(self._lineages, around, self.forward.dynamics, stamp_ns, lag, threshold)

    def _smooth_oldest(self) -> Estimates:
        estimates = super()._smooth_oldest()
        self._lineages.drop_before(self._window[0].stamp_ns)  # the next scan needs the memory
        return estimates

    def _figures(self, step: Filtered[Mixture, Link]) -> Mapping[str, float]:
        stored = step.entry.stored
        return {
            "hypotheses": len(stored),
            "origins": len(stored.label),
            "approximate_clusters": self.forward.approximate,
            "floored_covariances": self.forward.floored,
        }

    def _entry_to_snapshot(self, entry: GaussianEntry, stored: Snapshot, name: str) -> None:
        snapshot.entry_to_snapshot(entry, stored, name)

    def _entry_from_snapshot(
        self, stored: Snapshot, name: str, earlier: Mapping[int, GaussianEntry]
    ) -> GaussianEntry:
        most = self.forward.bounds.most
        return snapshot.entry_from_snapshot(stored, name, earlier, self.forward.dynamics, most)
