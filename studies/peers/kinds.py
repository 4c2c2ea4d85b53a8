"""The peers as kinds of tracker in a Monte Carlo study."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.study import definition
from phd_jdtc_ros.study.tracker import SimulatedRun, TrackingResult, Tracks

from .mixture_phd import gm_phd
from .plot_kalman import plot_kalman
from .settings import ANYWHERE, AT_BIRTH_PLACES, GM_PHD, LOUD, LOUD_THRESHOLD, Settings
from .threshold import raised_threshold
from .track_based import gnn, jpda


@dataclass(frozen=True)
class Peer:
    """One of Stone Soup's trackers with its settings."""

    tracker: Callable[..., Tracks]
    settings: Settings
    loud: bool = False  # True if it gets detections of high amplitude only
    smoothed: bool = False  # True if it has lags above 0 in studies

    def __call__(
        self, run: SimulatedRun, parameters: Mapping[str, Any], lags: Sequence[int]
    ) -> TrackingResult:
        """Return the estimates of a run."""
        received = raised_threshold(run, LOUD_THRESHOLD) if self.loud else run
        own: dict[str, Any] = {"lags": lags} if self.smoothed else {}
        model = resolve(parameters).model
        return TrackingResult(self.tracker(received, model, self.settings, **own))


# The peers of Stone Soup, by the name of their kind.
PEERS = {
    "gm_phd": Peer(gm_phd, GM_PHD),
    "gm_phd_loud": Peer(gm_phd, GM_PHD, loud=True),
    "gnn": Peer(gnn, AT_BIRTH_PLACES, smoothed=True),
    "gnn_loud": Peer(gnn, LOUD, loud=True, smoothed=True),
    "gnn_anywhere": Peer(gnn, ANYWHERE, smoothed=True),
    "jpda": Peer(jpda, AT_BIRTH_PLACES),
    "jpda_loud": Peer(jpda, LOUD, loud=True),
}
_MODULES = ("studies.peers",)
# All kinds of a study, those of an installed package included.
KINDS = {
    **definition.KINDS,
    **{
        name: replace(definition.KINDS[name], track=peer, modules=_MODULES, package="stonesoup")
        for name, peer in PEERS.items()
    },
    "plot_kalman": replace(definition.KINDS["plot_kalman"], track=plot_kalman, modules=_MODULES),
}
