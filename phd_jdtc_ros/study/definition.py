"""The definition of a study: cases, variants to run on each, goals, and the kinds of tracker.

A kind is a tracker with its settings: how it is run, on what, and its source files. Other trackers
are in the repository's `studies`, which give a study their own table of kinds; here their names are
known, and they are left out.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.configuration.tables import GROUPS, TOP
from phd_jdtc_ros.simulation.scenario import Scenario

from . import tracker
from .metrics import ACCUMULATORS
from .tracker import TAXIING, IgnoredTargets, SimulatedRun, TrackingResult

# Function of a run, the tracker's parameters and lags that returns the tracker's estimates.
Track: TypeAlias = "Callable[[SimulatedRun, Mapping[str, Any], Sequence[int]], TrackingResult]"


@dataclass(frozen=True)
class Kind:
    """A kind of tracker."""

    ELSEWHERE = "it runs with `python -m studies monte_carlo` in the repository"
    # Modules and packages that the scores of every kind depend on.
    SHARED = (
        *(
            f"phd_jdtc_ros.{name}"
            for name in (
                *("calibration", "columns", "configuration", "core", "evaluation", "feed", "tally"),
                "simulation",
            )
        ),
        "phd_jdtc_ros.quoting",
        "phd_jdtc_ros.study.reference",
        "phd_jdtc_ros.study.tracker",
        "phd_jdtc_ros.study.tasks",
    )

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
            return self.ELSEWHERE
        if self.package and importlib.util.find_spec(self.package) is None:
            return f"{self.package} is not installed"
        return None

    def sources(self) -> list[Path]:
        """Return the source files that the scores depend on: tracker, tasks and scoring."""
        return [path for module in (*self.SHARED, *self.modules) for path in _files_of(module)]


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
    from .reference import known_association

    return TrackingResult(known_association(run, lags))


def _best_reference(run: SimulatedRun, _: Mapping[str, Any], lags: Sequence[int]) -> TrackingResult:
    from .reference import BEST_NOISE, known_association

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


# Default cut-off c of OSPA and GOSPA, metres, and their order p.
CUTOFF, ORDER = 1000.0, 2.0
METRICS = {metric.key: metric for each in ACCUMULATORS for metric in each.metrics}
# Name of the figure: reduction of the mean OSPA against lag 0.
REDUCTION = "reduction"
FIGURES = (*METRICS, REDUCTION)
# Parameters that the study sets itself.
OWN = ("lag", "lag_s", "seed")


@dataclass(frozen=True)
class Case:
    """A scenario and the tracker's parameters for it, shared by all variants."""

    name: str
    scenario: Scenario
    # Parameters of the tracker by dotted name; they also define the scenario's radars.
    parameters: dict[str, Any]
    classes: int
    cutoff: float | None = None  # The c of OSPA and GOSPA, metres; None for the study's
    ignored: IgnoredTargets = TAXIING  # Unscored targets if antennas turn
    # Share of the requested runs, above 0 and at most 1, for expensive cases.
    run_share: float = 1.0
    # The only lags of variants that are run on this case; None for all.
    lags: tuple[int, ...] | None = None

    def lags_of(self, variant: Variant) -> tuple[int, ...]:
        """Return the lags of a variant on this case."""
        return tuple(lag for lag in variant.lags if self.lags is None or lag in self.lags)


@dataclass(frozen=True)
class Variant:
    """One tracker with its settings."""

    name: str
    kind: Kind
    # Parameters of the tracker that replace the case's; they do not change the simulated data. A
    # name with ``*`` in the place of a class applies to all classes of the case.
    parameters: dict[str, Any]
    cases: tuple[str, ...]
    lags: tuple[int, ...]  # Ascending
    run_share: float = 1.0  # As for a case; the smaller of both applies


@dataclass(frozen=True)
class Goal:
    """A bound on the mean of a figure over all targets."""

    name: str
    case: str
    variant: str
    lag: int
    figure: str  # One of `FIGURES`
    bound: float
    at_most: bool  # True if it is an upper bound
    relative_to: str | None  # Variant whose figure `bound` multiplies; None for an absolute bound
    relative_case: str  # Case of that figure


@dataclass(frozen=True)
class Study:
    """A checked study."""

    cases: tuple[Case, ...]
    variants: tuple[Variant, ...]
    goals: tuple[Goal, ...]
    assigned: dict[str, Any]  # Parameters that replace those of cases and variants
    cutoff: float = CUTOFF  # The c of OSPA and GOSPA, metres, in cases without their own
    # Variants that name an engine other than the assigned one, with the reasons.
    left_out: Mapping[str, str] = field(default_factory=dict)

    def cutoff_of(self, case: Case) -> float:
        """Return the c of OSPA and GOSPA in a case, metres."""
        return self.cutoff if case.cutoff is None else case.cutoff

    def parameters(self, case: Case, variant: Variant) -> dict[str, Any]:
        """Return the tracker's parameters for a variant and a case."""
        return merge_layers(case.parameters, variant.parameters, self.assigned)

    def runs(self, case: Case, variant: Variant, asked: int) -> int:
        """Return the number of runs of a variant at a case, of `asked` requested ones."""
        return math.ceil(min(case.run_share, variant.run_share) * asked)

    @property
    def in_full(self) -> Study:
        """The study without reduced shares of runs."""
        return replace(
            self,
            cases=tuple(replace(case, run_share=1.0) for case in self.cases),
            variants=tuple(replace(variant, run_share=1.0) for variant in self.variants),
        )

    def select(self, cases: Sequence[str], variants: Sequence[str]) -> Study:
        """Return the study of the named cases and variants, or of all; or raise `ConfigError`."""
        faults = _unknown("--case", cases, [case.name for case in self.cases])
        faults += _unknown("--variant", variants, [variant.name for variant in self.variants])
        if faults:
            raise ConfigError(*faults)
        return replace(
            self,
            cases=tuple(case for case in self.cases if not cases or case.name in cases),
            variants=tuple(v for v in self.variants if not variants or v.name in variants),
        )


def _unknown(option: str, names: Sequence[str], known: Sequence[str]) -> list[str]:
    return [
        f"{option}: {name!r} given, must be one of {', '.join(known)}"
        for name in names
        if name not in known
    ]


def merge_layers(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of several layers, in which later layers replace earlier ones.

    If a layer lists the radars, classes, motions or births again, the parameters of the omitted
    ones are removed. A parameter of ``*`` is copied to each class, unless the same layer
    sets it for that class.
    """
    default_names = {p.name: p.default for p in TOP if p.name in GROUPS}
    result: dict[str, Any] = {}
    for layer in layers:
        for group in GROUPS:
            kept = layer.get(group)
            if isinstance(kept, list):
                names = result.get(group, default_names[group])
                removed = {str(name) for name in names if name not in kept}
                result = {k: v for k, v in result.items() if k.split(".")[0] not in removed}
        classes = layer.get("classes", result.get("classes", default_names["classes"]))
        names = map(str, classes) if isinstance(classes, list) else ()
        result.update(_of_every_class(layer, tuple(names)))
    return result


def _of_every_class(layer: Mapping[str, Any], classes: Sequence[str]) -> dict[str, Any]:
    """Return a layer's parameters with ``*`` replaced by the name of each class."""
    shared = {name: value for name, value in layer.items() if name.startswith("*.")}
    of_classes = {
        f"{kind}{name.removeprefix('*')}": value
        for name, value in shared.items()
        for kind in classes
    }
    return of_classes | {name: value for name, value in layer.items() if name not in shared}
