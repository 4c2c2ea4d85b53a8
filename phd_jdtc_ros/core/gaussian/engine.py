"""The Gaussian engine: the filter, the backward smoother and the extraction of mixtures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..arrays import IntArray
from ..snapshot import Snapshot
from ..types import Estimates
from ..window.fixed_lag import FixedLagEngine, Part
from ..window.forward_filter import Filtered
from . import snapshot
from .extraction import extract, extract_all
from .filter import GaussianFilter
from .mixture import Mixture
from .smoother import Link, backward_pass
from .snapshot import GaussianEntry


@dataclass
class GaussianEngine(FixedLagEngine[Mixture, Link]):
    """Gaussian mixtures of labelled targets with a fixed-lag backward smoother.

    Parameters
    ----------
    rule : ReportingRule
        When tracks are reported.
    """

    forward: GaussianFilter

    def _extract(self, stored: Mixture, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        return extract(stored, self.forward.dynamics, stamp_ns, lag, threshold)

    def _extract_all(self, parts: Sequence[Part[Mixture]], lag: int) -> tuple[Estimates, IntArray]:
        return extract_all(parts, self.forward.dynamics, lag)

    def _backward(self, window: Sequence[GaussianEntry]) -> Sequence[Mixture]:
        return backward_pass(window)

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
