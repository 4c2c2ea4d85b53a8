"""The kinds of tracker in a study: how each is run, on what, and its source files.

A kind is a tracker with its settings. Other trackers are in the repository's `studies`, which give
a study their own table of kinds; here their names are known, and they are left out.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

from phd_jdtc_ros.configuration.engines import ENGINES

from .. import tracker
from ..tracker import SimulatedRun, TrackingResult

# Function of a run, the tracker's parameters and lags that returns the tracker's estimates.
Track: TypeAlias = "Callable[[SimulatedRun, Mapping[str, Any], Sequence[int]], TrackingResult]"

ELSEWHERE = "it runs with `python -m studies monte_carlo` in the repository"
# Modules and packages that the scores of every kind depend on.
SHARED = (
    *(
        f"phd_jdtc_ros.{name}"
        for name in (
            *("calibration", "columns", "configuration", "core", "evaluation", "feed"),
            "simulation",
        )
    ),
    "phd_jdtc_ros.quoting",
    *(
        f"phd_jdtc_ros.study.{name}"
        for name in (
            *("reference", "tracker"),
            *("monte_carlo.scores", "monte_carlo.tasks"),
        )
    ),
)


@dataclass(frozen=True)
class Kind:
    """A kind of tracker."""

    name: str
    # None for this package's engines, whose variants share a filter, and for what is left out.
    track: Track | None = None
    modules: tuple[str, ...] = ()  # Modules and packages that the scores depend on, after `SHARED`
    turning: bool = False  # True if it runs on the cases with turning antennas only
    ours: bool = False  # True if it is this package's tracker
    tuned: bool = False  # True if a variant may have parameters of the tracker
    known_association: bool = False  # True if it is given the source of every detection
    classes: bool = True  # True if it estimates classes
    package: str = ""  # Optional package that it needs

    @property
    def is_engine(self) -> bool:
        """Whether it is this package's tracker on scans."""
        return self.ours and not self.turning

    def missing(self) -> str | None:
        """Return the reason why the kind cannot run on this machine, or None."""
        if self.track is None and not self.ours:
            return ELSEWHERE
        if self.package and importlib.util.find_spec(self.package) is None:
            return f"{self.package} is not installed"
        return None

    def sources(self) -> list[Path]:
        """Return the source files that the scores depend on: tracker, tasks and scoring."""
        return [path for module in (*SHARED, *self.modules) for path in _files_of(module)]


def _files_of(module: str) -> list[Path]:
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    origin = Path(spec.origin)
    return sorted(origin.parent.rglob("*.py")) if origin.stem == "__init__" else [origin]


@cache
def code_of(kind: Kind) -> str:
    """Return a digest of the files, and of the package, that a kind's scores depend on."""
    digest = hashlib.sha256()
    for path in kind.sources():
        digest.update(path.name.encode() + path.read_bytes())
    if kind.package and kind.missing() is None:
        digest.update(metadata.version(kind.package).encode())
    return digest.hexdigest()


# `reference` loads compiled code, so that only a run with it imports it.
def _reference(run: SimulatedRun, _: Mapping[str, Any], lags: Sequence[int]) -> TrackingResult:
    from ..reference import known_association

    return TrackingResult(known_association(run, lags))


def _best_reference(run: SimulatedRun, _: Mapping[str, Any], lags: Sequence[int]) -> TrackingResult:
    from ..reference import BEST_NOISE, known_association

    return TrackingResult(known_association(run, lags, BEST_NOISE))


_STONE_SOUP = ("gm_phd", "gm_phd_loud", "gnn", "gnn_loud", "gnn_anywhere", "jpda", "jpda_loud")
# The kinds of an installed package, by name.
KINDS = {
    kind.name: kind
    for kind in (
        *(Kind(name, ours=True, tuned=True) for name in ENGINES),
        Kind("turning", tracker.track_turning, turning=True, ours=True, tuned=True),
        Kind("reference", _reference, known_association=True),
        Kind("reference_best", _best_reference, known_association=True),
        *(Kind(name, tuned=True, classes=False) for name in _STONE_SOUP),
        Kind("plot_kalman", turning=True, classes=False),
    )
}
