"""What the layer knows after a scan, for the functions that read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly
from .model import Receiver
from .tables import Learned, Links, Pairs, Sources, Tracks

# Weight of a configured probability against the learned one, as a number of reports.
PRIOR_REPORTS = 50.0


@dataclass(frozen=True, eq=False)
class LayerState(ReadOnly):
    """Sources, pairs and tracks, and what was learned of K receivers."""

    receivers: tuple[Receiver, ...]
    # Spectral density of the tracks' acceleration, m^2/s^3.
    noise_density: float
    classes: int
    sources: Sources
    pairs: Pairs
    tracks: Tracks
    links: tuple[Links, ...]  # Of pairs back to earlier scans, oldest first
    learned: Learned

    @property
    def lost(self) -> FloatArray:
        """Probability that each receiver loses a report, (K,)."""
        prior = np.array([each.lost for each in self.receivers])
        learns = np.array([each.learns_lost for each in self.receivers])
        got, sent = self.learned.received.T
        learned = 1.0 - (PRIOR_REPORTS * (1.0 - prior) + got) / (PRIOR_REPORTS + sent)
        found: FloatArray = np.where(learns, np.clip(learned, 0.01, 0.9), prior)
        return found

    def intervals(self, sources: Sources) -> FloatArray:
        """Return the interval of the reports of sources, seconds, (S,)."""
        covariance = sources.covariance[:, 2:4, 2:4]
        return self.intervals_of(sources.receiver, sources.mean[:, 2:4], covariance, sources.gap_s)

    def intervals_of(
        self,
        receiver: IntArray,
        velocity: FloatArray,
        covariance: FloatArray,
        gap_s: FloatArray,
    ) -> FloatArray:
        """Return the interval of the reports of transmitters with velocities, seconds, (N,).

        `receiver` is the index of each one's, `covariance` that of its velocity, and `gap_s` its
        shortest observed interval, 0 if there is none.
        """
        speed = np.hypot(*velocity.T)
        std = np.sqrt(np.einsum("nkk->n", covariance) / 2.0)
        found = np.ones(len(speed))
        for index, each in enumerate(self.receivers):
            mine = receiver == index
            # Reports of a second step can be a second nearer to each other than they were sent.
            least = np.maximum(gap_s[mine] - each.habits.time_step_s, 0.0)
            found[mine] = each.interval_of(speed[mine], std[mine], least)
        return found

    @property
    def owned(self) -> FloatArray:
        """Probability of each source that it owns any track, (S,)."""
        total = np.zeros(len(self.sources.number))
        np.add.at(total, self.sources.number.searchsorted(self.pairs.source), self.pairs.owned)
        return np.minimum(total, 1.0)
