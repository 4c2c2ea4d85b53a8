"""A Monte Carlo study: many seeded runs of several trackers on several scenarios, and their scores.

A study's way through the module::

    study file (YAML, read elsewhere)
      |  resolve: all faults at once
    Study: cases x variants, goals
      |  plan: a task is a case, variants that share a filter, and a seed
    Task ...                 those whose scores are stored already are left out
      |  run_on_processes, run_on_dask: lost workers' tasks are run again
    Outcome -> Store         a file of tidy rows for each case, variant and seed
      |  collect, write_csv, summarise
    results.csv, summary.json

The data of a run depend on case and seed alone, so that all variants of a case see the same scans
and differences between them are paired.
"""

from __future__ import annotations

import ast
import contextlib
import csv
import gzip
import hashlib
import importlib.util
import io
import json
import math
import multiprocessing
import os
import re
import signal
import tempfile
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import stats

import phd_jdtc_ros
from phd_jdtc_ros.core import config as tracker_config
from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.extraction import EXTRACTIONS
from phd_jdtc_ros.core.metrics import assign, ospa
from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.core.parameters import GROUPS, TOP, Parameter, flatten
from phd_jdtc_ros.core.radar import RadarModel
from phd_jdtc_ros.core.simulation import Scenario, paper_scenario
from phd_jdtc_ros.core.smoother import DEATH_TERMS
from phd_jdtc_ros.core.types import FloatArray

from .ours import Reading, track
from .runs import SimulatedRun, Tracks, simulated_run

# OSPA's c (metres) and p; and the other ones, for all targets only.
CUTOFF, ORDER = 1000.0, 2.0
OTHER_ORDER, OTHER_CUTOFF = 1.0, 300.0

OURS, REFERENCE, GM_PHD, GNN, JPDA = KINDS = ("ours", "reference", "gm_phd", "gnn", "jpda")
PEERS = (GM_PHD, GNN, JPDA)
PEERS_PACKAGE = "stonesoup"
BUILT_IN_SCENARIO = "paper_scenario"

ALL = "all"
VALUES = (
    "ospa",
    "localization",
    "cardinality",
    "n_true",
    "n_est",
    "pairs",
    "right_class",
    "ospa_p1",
    "ospa_c300",
)
HEADER = ("case", "variant", "lag", "seed", "scan", "time_s", "set", *VALUES)
COUNTS = ("n_true", "n_est", "pairs", "right_class")
FIGURES = (
    "ospa",
    "localization",
    "cardinality",
    "cardinality_abs_error",
    "class_accuracy",
    "reduction",
)

# A change of what a stored row means changes this.
FORMAT = 1
# How often a task may take its worker with it.
TRIES = 3
DASK_TIMEOUT_S = 10
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


# --- the definition -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """What all variants are given.

    Parameters
    ----------
    name : str
    scenario : Scenario
    parameters : dict
        The tracker's, by dotted name; the radars of the scenario are theirs.
    classes : int
    """

    name: str
    scenario: Scenario
    parameters: dict[str, Any]
    classes: int


@dataclass(frozen=True)
class Variant:
    """One tracker.

    Parameters
    ----------
    name : str
    kind : str
        Of `KINDS`.
    reading : Reading or None
        None for other kinds than ours.
    parameters : dict
        Over the case's, for the tracker; the data stay the case's.
    cases : tuple of str
    lags : tuple of int
        Ascending.
    """

    name: str
    kind: str
    reading: Reading | None
    parameters: dict[str, Any]
    cases: tuple[str, ...]
    lags: tuple[int, ...]


@dataclass(frozen=True)
class Goal:
    """A bound on the mean of a figure over all targets.

    Parameters
    ----------
    name, case, variant : str
    lag : int
    figure : str
        Of `FIGURES`.
    bound : float
    at_most : bool
        Whether the bound is an upper one.
    relative_to : str or None
        The variant whose figure the bound is a multiple of.
    """

    name: str
    case: str
    variant: str
    lag: int
    figure: str
    bound: float
    at_most: bool
    relative_to: str | None


@dataclass(frozen=True)
class Study:
    """A checked study.

    Parameters
    ----------
    cases : tuple of Case
    variants : tuple of Variant
    goals : tuple of Goal
    assigned : dict
        Parameters over all others.
    """

    cases: tuple[Case, ...]
    variants: tuple[Variant, ...]
    goals: tuple[Goal, ...]
    assigned: dict[str, Any]

    def parameters(self, case: Case, variant: Variant) -> dict[str, Any]:
        """Return the tracker's parameters of a variant at a case."""
        return merged(case.parameters, variant.parameters, self.assigned)

    def select(self, cases: Sequence[str], variants: Sequence[str]) -> Study:
        """Return the study of some cases and variants; of all where none is named.

        Raises
        ------
        ConfigError
            With every unknown name.
        """
        faults = _unknown("--case", cases, [case.name for case in self.cases])
        faults += _unknown("--variant", variants, [variant.name for variant in self.variants])
        if faults:
            raise ConfigError(faults)
        return replace(
            self,
            cases=tuple(case for case in self.cases if not cases or case.name in cases),
            variants=tuple(v for v in self.variants if not variants or v.name in variants),
        )


def merged(*layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of several layers, the later over the earlier ones.

    A layer that names the radars, classes, motions or births anew also takes away what earlier
    layers say of those that it leaves out.
    """
    result: dict[str, Any] = {}
    for layer in layers:
        for group in GROUPS:
            kept = layer.get(group)
            if isinstance(kept, list):
                left = result.get(group, _DEFAULT_NAMES[group])
                gone = {str(name) for name in left if name not in kept}
                result = {k: v for k, v in result.items() if k.split(".")[0] not in gone}
        result.update(layer)
    return result


_DEFAULT_NAMES = {p.name: p.default for p in TOP if p.name in GROUPS}

# A scenario file's parameters by dotted name, and its scenario given the radars.
Scene: TypeAlias = "tuple[Mapping[str, Any], Callable[[tuple[RadarModel, ...]], Scenario]]"

LAG = Parameter("lag", 0, "", 0, 100)
BOUND = Parameter("bound", 0.0, "")
# The study says these itself.
OWN = ("lag", "lag_s", "seed", "death_term", "extraction")
OURS_ONLY = ("death_term", "extraction", "parameters")


def resolve(
    document: Any, load_scene: Callable[[str], Scene], assigned: Mapping[str, Any]
) -> Study:
    """Check a study document and build what it describes.

    Parameters
    ----------
    document : mapping
        ``lags``, ``cases``, ``variants`` and ``goals``, as in `config/studies/published.yaml`.
    load_scene : callable of str
        Reads a scenario file as the document names it.
    assigned : mapping
        Tracker parameters over all others.

    Raises
    ------
    ConfigError
        With every fault.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["study: must be a mapping"])
    faults = _unknown_keys(document, "", ("lags", "cases", "variants", "goals"))
    faults += _own_faults("-p ", assigned)
    lags = _lags(document.get("lags"), "lags", faults)
    found = [
        _case(name, given, load_scene, assigned, faults)
        for name, given in _entries(document, "cases", faults)
    ]
    names = [name for name, _ in _entries(document, "cases", [])]
    variants = [
        _variant(name, given, names, lags, faults)
        for name, given in _entries(document, "variants", faults)
    ]
    goals = [
        _goal(given, f"goals[{index}].", names, variants, faults)
        for index, given in enumerate(_list(document, "goals", faults))
    ]
    cases = tuple(case for case in found if case is not None)
    study = Study(cases, tuple(variants), tuple(goals), dict(assigned))
    faults += _tracker_faults(study)
    if faults:
        raise ConfigError(list(dict.fromkeys(faults)))
    return study


def _case(
    name: str,
    given: Mapping[str, Any],
    load_scene: Callable[[str], Scene],
    assigned: Mapping[str, Any],
    faults: list[str],
) -> Case | None:
    """Return a checked case, or None after adding what is wrong to `faults`."""
    prefix = f"cases.{name}."
    faults += _unknown_keys(given, prefix, ("scenario", "parameters"))
    own = _parameters(given, prefix, faults)
    where = given.get("scenario")
    if not isinstance(where, str):
        faults.append(
            f"{prefix}scenario: {where!r} given, must be {BUILT_IN_SCENARIO} or a scenario file"
        )
        return None
    try:
        in_file, build = ({}, paper_scenario) if where == BUILT_IN_SCENARIO else load_scene(where)
        parameters = merged(in_file, own, assigned)
        model = tracker_config.resolve(parameters).model
        scenario, classes = build(model.radars), len(model.modes.classes)
        highest = max((target.class_id for target in scenario.targets), default=0)
        if highest >= classes:
            raise ConfigError([f"class {highest} of a target, must be below {classes}"])
        return Case(name, scenario, parameters, classes)
    except ConfigError as error:
        for fault in error.faults:
            name = fault.split(":")[0]
            faults.append(
                f"-p {fault}"
                if name in assigned
                else f"{prefix}parameters.{fault}"
                if name in own
                else f"{prefix}scenario: {fault}"
            )
        return None


def _variant(
    name: str,
    given: Mapping[str, Any],
    cases: Sequence[str],
    lags: tuple[int, ...],
    faults: list[str],
) -> Variant:
    """Return a variant; add what is wrong to `faults`."""
    prefix = f"variants.{name}."
    faults += _unknown_keys(given, prefix, ("kind", "cases", "lags", *OURS_ONLY))
    kind = _choice(given, "kind", prefix, KINDS, None, faults)
    if kind != OURS:
        faults += [f"{prefix}{key}: only for kind {OURS}" for key in OURS_ONLY if key in given]
        reading = None
    else:
        death_term = _choice(given, "death_term", prefix, DEATH_TERMS, "bernoulli", faults)
        extraction = _choice(given, "extraction", prefix, EXTRACTIONS, "components", faults)
        reading = Reading(name, death_term, extraction)
    chosen = given.get("cases", list(cases))
    if not isinstance(chosen, list) or not chosen or not set(map(str, chosen)) <= set(cases):
        faults.append(f"{prefix}cases: {chosen!r} given, must be a list of {', '.join(cases)}")
        chosen = []
    return Variant(
        name=name,
        kind=kind,
        reading=reading,
        parameters=_parameters(given, prefix, faults),
        cases=tuple(chosen),
        lags=_lags(given["lags"], f"{prefix}lags", faults) if "lags" in given else lags,
    )


def _goal(
    given: Any, prefix: str, cases: Sequence[str], variants: Sequence[Variant], faults: list[str]
) -> Goal:
    """Return a goal; add what is wrong to `faults`."""
    if not isinstance(given, Mapping):
        faults.append(f"{prefix[:-1]}: must be a mapping")
        given = {}
    keys = ("name", "case", "variant", "lag", "figure", "at_most", "at_least", "relative_to")
    faults += _unknown_keys(given, prefix, keys)
    names = [variant.name for variant in variants]
    bounds = [key for key in ("at_most", "at_least") if key in given]
    if len(bounds) != 1 or BOUND.coerce(given[bounds[0]]) is None:
        faults.append(f"{prefix}at_most: must be a number, or at_least be one, not both")
    lag = LAG.coerce(given.get("lag"))
    if lag is None:
        faults.append(f"{prefix}lag: {given.get('lag')!r} given, must be {LAG.allowed}")
    relative = given.get("relative_to")
    if relative is not None:
        _choice(given, "relative_to", prefix, names, None, faults)
    return Goal(
        name=str(given.get("name", prefix)),
        case=_choice(given, "case", prefix, cases, None, faults),
        variant=_choice(given, "variant", prefix, names, None, faults),
        lag=lag if isinstance(lag, int) else 0,
        figure=_choice(given, "figure", prefix, FIGURES, None, faults),
        bound=given[bounds[0]] if bounds else math.nan,
        at_most=bounds == ["at_most"],
        relative_to=relative,
    )


def _tracker_faults(study: Study) -> Iterator[str]:
    """Yield what is wrong with the parameters of each variant at each of its cases."""
    for variant in study.variants:
        for case in study.cases:
            if variant.kind == OURS and case.name in variant.cases and variant.parameters:
                try:
                    tracker_config.resolve(study.parameters(case, variant))
                except ConfigError as error:
                    for fault in error.faults:
                        yield f"variants.{variant.name}.parameters.{fault}"


def _parameters(given: Mapping[str, Any], prefix: str, faults: list[str]) -> dict[str, Any]:
    value = given.get("parameters", {})
    if not isinstance(value, Mapping):
        faults.append(f"{prefix}parameters: must be a mapping")
        return {}
    parameters = dict(flatten(value))
    faults += _own_faults(f"{prefix}parameters.", parameters)
    return parameters


def _own_faults(prefix: str, parameters: Mapping[str, Any]) -> list[str]:
    return [f"{prefix}{name}: the study says it itself" for name in OWN if name in parameters]


def _entries(
    document: Mapping[str, Any], key: str, faults: list[str]
) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the named mappings under a key."""
    value = document.get(key)
    if not isinstance(value, Mapping) or not value:
        faults.append(f"{key}: must be a mapping of at least one name")
        return []
    for name, given in value.items():
        if not isinstance(name, str) or not isinstance(given, Mapping):
            faults.append(f"{key}.{name}: must be a mapping with a string for a name")
    return [(n, g) for n, g in value.items() if isinstance(n, str) and isinstance(g, Mapping)]


def _list(document: Mapping[str, Any], key: str, faults: list[str]) -> list[Any]:
    value = document.get(key, [])
    if isinstance(value, list):
        return value
    faults.append(f"{key}: must be a list")
    return []


def _lags(value: Any, name: str, faults: list[str]) -> tuple[int, ...]:
    lags = [LAG.coerce(entry) for entry in value] if isinstance(value, list) else []
    if not lags or None in lags or len(set(lags)) < len(lags):
        faults.append(f"{name}: {value!r} given, must be a list, none twice: {LAG.allowed}")
        return ()
    return tuple(sorted(lag for lag in lags if isinstance(lag, int)))


def _choice(
    given: Mapping[str, Any],
    key: str,
    prefix: str,
    allowed: Iterable[str],
    default: str | None,
    faults: list[str],
) -> str:
    value = given.get(key, default)
    if not isinstance(value, str) or value not in allowed:
        faults.append(f"{prefix}{key}: {value!r} given, must be one of {', '.join(allowed)}")
    return str(value)


def _unknown_keys(given: Mapping[str, Any], prefix: str, known: Iterable[str]) -> list[str]:
    return [f"{prefix}{name}: unknown key" for name in given if name not in known]


def _unknown(option: str, names: Sequence[str], known: Sequence[str]) -> list[str]:
    return [
        f"{option}: {name!r} given, must be one of {', '.join(known)}"
        for name in names
        if name not in known
    ]


# --- one task -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Task:
    """One seeded run of variants that share their data and, if they are ours, one filter.

    Parameters
    ----------
    case : str
    scenario : Scenario
    classes : int
    variants : tuple of Variant
        Of one kind.
    parameters : dict
        The tracker's.
    seed : int
    code : str
        Digest of the code that is to run, see `code_of`.
    digests : dict
        By the name of the variant: of all that its scores depend on, but for the seed.
    """

    case: str
    scenario: Scenario
    classes: int
    variants: tuple[Variant, ...]
    parameters: dict[str, Any]
    seed: int
    code: str
    digests: dict[str, str]

    @property
    def kind(self) -> str:
        """The variants' kind."""
        return self.variants[0].kind

    @property
    def label(self) -> str:
        """What the task is, in words."""
        return f"{self.case}, {' + '.join(v.name for v in self.variants)}, seed {self.seed}"


class Scores(NamedTuple):
    """One variant's scores of one run, or several.

    Parameters
    ----------
    lags : tuple of int
    sets : tuple of str
        ``all`` and, for trackers that tell classes, one ``class_k`` a class.
    time_s : array of shape (scans,)
        From the first scan.
    values : array of shape (..., lags, scans, sets, VALUES)
        NaN where there is no such value.
    """

    lags: tuple[int, ...]
    sets: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Parameters
    ----------
    task : Task
    scores : dict
        By the name of the variant; empty if it failed.
    error : str
        Empty if it did not.
    """

    task: Task
    scores: dict[str, Scores] = field(default_factory=dict)
    error: str = ""


def perform(task: Task) -> Outcome:
    """Run a task; a failure is part of the outcome."""
    try:
        if code_of(task.kind) != task.code:
            raise RuntimeError("the worker has other code than the study; start the study anew")
        run = simulated_run(task.scenario, task.seed)
        tracks = _tracks(task, run)
        scores = {
            variant.name: score(run, tracks[variant.name], variant, task.classes)
            for variant in task.variants
        }
    except Exception:
        return Outcome(task, error=traceback.format_exc())
    return Outcome(task, scores)


def _tracks(task: Task, run: SimulatedRun) -> dict[str, Tracks]:
    """Return the estimates by the name of the variant."""
    lags = sorted({lag for variant in task.variants for lag in variant.lags})
    if task.kind == OURS:
        readings = [variant.reading for variant in task.variants if variant.reading is not None]
        return track(run, tracker_config.resolve(task.parameters), readings, lags)
    if task.kind == REFERENCE:
        tracks = _module(REFERENCE).known_association(run, lags)
    elif task.kind == GNN:
        tracks = _module(GNN).gnn(run, lags)
    else:
        tracks = getattr(_module(task.kind), task.kind)(run)
    return {variant.name: tracks for variant in task.variants}


def _module(kind: str) -> Any:
    """Return the module of a kind; the peers' one is not needed by the others."""
    return import_module(f"{__package__}.{'peers' if kind in PEERS else kind}")


def score(run: SimulatedRun, tracks: Tracks, variant: Variant, classes: int) -> Scores:
    """Return the scores of those lags of a variant that its tracker has.

    Notes
    -----
    Rounded to a millimetre, so that a file of them is short and reads back as it was. ``pairs``
    are targets of the set with an estimate assigned by position alone, closer than the cutoff;
    ``right_class`` those among them whose estimate has their class.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} wanted, the tracker has {sorted(tracks)}")
    classified = variant.kind not in PEERS
    sets = (ALL, *(f"class_{k}" for k in range(classes if classified else 0)))
    values = np.full((len(lags), len(run.scans), len(sets), len(VALUES)), np.nan)
    for row, lag in zip(values, lags, strict=True):
        for scan, (truth, found) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            targets = PointSet(truth.state[:, list(POSITION)], truth.class_id)
            row[scan] = _scan_scores(targets, found, len(sets), classified)
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3))


def _scan_scores(truth: PointSet, found: PointSet, sets: int, classified: bool) -> FloatArray:
    """Return the values of one scan, shape (sets, VALUES)."""
    target, estimate = assign(truth.position, found.position, CUTOFF)
    right = truth.class_id[target] == found.class_id[estimate]
    whole = _set_scores(truth, found, right, classified)
    whole["ospa_p1"] = ospa(truth.position, found.position, CUTOFF, OTHER_ORDER).distance
    whole["ospa_c300"] = ospa(truth.position, found.position, OTHER_CUTOFF, ORDER).distance
    rows = [whole]
    for k in range(sets - 1):
        own = right[truth.class_id[target] == k]
        rows.append(_set_scores(truth.of_class(k), found.of_class(k), own, classified))
    return np.array([[row.get(name, math.nan) for name in VALUES] for row in rows])


def _set_scores(
    truth: PointSet, found: PointSet, right: npt.NDArray[np.bool_], classified: bool
) -> dict[str, float]:
    """Return a set's values, given for each of its pairs whether it has the right class."""
    distance = ospa(truth.position, found.position, CUTOFF, ORDER)
    return {
        "ospa": distance.distance,
        "localization": distance.localization,
        "cardinality": distance.cardinality,
        "n_true": len(truth),
        "n_est": len(found),
        "pairs": len(right),
        "right_class": int(right.sum()) if classified else math.nan,
    }


# --- what is stored -------------------------------------------------------------------------------


@cache
def code_of(kind: str) -> str:
    """Return a digest of the code that a kind's estimates depend on.

    Comments and docstrings do not count, so that editing them keeps stored results.
    """
    here = Path(__file__).parent
    own = "peers" if kind in PEERS else kind
    paths = [*sorted((here.parent / "core").glob("*.py")), here / "runs.py", here / f"{own}.py"]
    digest = hashlib.sha256()
    for path in paths:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [n for n in body if not _is_text(n)]  # type: ignore[attr-defined]
        digest.update(f"{path.name} {ast.dump(tree)}".encode())
    if kind in PEERS and missing(kind) is None:
        digest.update(metadata.version(PEERS_PACKAGE).encode())
    return digest.hexdigest()


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def missing(kind: str) -> str | None:
    """Return why a kind cannot be run here, or None."""
    if kind in PEERS and importlib.util.find_spec(PEERS_PACKAGE) is None:
        return f"{PEERS_PACKAGE} is not installed"
    return None


@dataclass(frozen=True)
class Store:
    """Scores on disk, a file for each case, variant and seed.

    Parameters
    ----------
    directory : Path
        Made if it does not exist.
    """

    directory: Path

    def path(self, task: Task, variant: Variant) -> Path:
        """Return the file of a variant's scores; its name tells what they depend on."""
        digest = task.digests[variant.name]
        name = f"{slug(task.case)}.{slug(variant.name)}.{task.seed}.{digest}.csv.gz"
        return self.directory / name

    def write(self, task: Task, variant: Variant, scores: Scores) -> None:
        """Write scores; a file is there as a whole or not at all."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(_rows(task, variant, scores))
        self.directory.mkdir(parents=True, exist_ok=True)
        # Without a time, so that equal scores are equal bytes.
        write_atomically(
            self.path(task, variant), gzip.compress(text.getvalue().encode(), 6, mtime=0)
        )

    def read(self, task: Task, variant: Variant) -> Scores | None:
        """Return stored scores, or None if there are none or they cannot be read."""
        try:
            with gzip.open(self.path(task, variant), "rt", newline="") as file:
                header, *rows = csv.reader(file)
        except (OSError, EOFError, ValueError):
            return None
        return _scores(rows) if tuple(header) == HEADER else None


def _rows(task: Task, variant: Variant, scores: Scores) -> Iterator[list[Any]]:
    """Yield scores as tidy rows in the order of the header."""
    for lag, of_lag in zip(scores.lags, scores.values, strict=True):
        for scan, (time, of_scan) in enumerate(zip(scores.time_s, of_lag, strict=True)):
            for name, values in zip(scores.sets, of_scan, strict=True):
                fixed = [task.case, variant.name, lag, task.seed, scan, round(time, 9), name]
                yield [*fixed, *map(_cell, VALUES, values.tolist())]


def _cell(name: str, value: float) -> str:
    if math.isnan(value):
        return ""
    return f"{value:.0f}" if name in COUNTS else repr(value)


def _scores(rows: Sequence[Sequence[str]]) -> Scores:
    """Return what `_rows` made rows of."""
    lags = tuple(dict.fromkeys(int(row[2]) for row in rows))
    times = list(dict.fromkeys(row[5] for row in rows))
    sets = tuple(dict.fromkeys(row[6] for row in rows))
    values = np.array([[float(cell or "nan") for cell in row[7:]] for row in rows])
    shape = (len(lags), len(times), len(sets), len(VALUES))
    return Scores(lags, sets, np.array(times, dtype=float), values.reshape(shape))


def slug(name: str) -> str:
    """Return a name that any file system takes."""
    return re.sub(r"[^\w]+", "_", name)


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that it is there as a whole or not at all."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".tmp")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        # mkstemp keeps others out; a result is for all who may read the directory.
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


# --- many tasks -----------------------------------------------------------------------------------

Report: TypeAlias = Callable[[Outcome], None]
Work: TypeAlias = Callable[[Task], Outcome]


class Plan(NamedTuple):
    """What a study amounts to.

    Parameters
    ----------
    tasks : list of Task
        Seed by seed, so that a study that is stopped has something of everything.
    notes : list of str
        What is left out, and why.
    """

    tasks: list[Task]
    notes: list[str]


def plan(study: Study, seeds: Sequence[int]) -> Plan:
    """Return every task of a study."""
    gone = {v.name: reason for v in study.variants if (reason := missing(v.kind)) is not None}
    notes = [f"{name}: left out, {reason}" for name, reason in gone.items()]
    first_seed = []
    for case in study.cases:
        groups: dict[str, list[Variant]] = {}
        for variant in study.variants:
            if case.name in variant.cases and variant.name not in gone:
                # Others than ours have nothing to share.
                own = "" if variant.kind == OURS else variant.name
                key = json.dumps([variant.kind, own, variant.parameters], sort_keys=True)
                groups.setdefault(key, []).append(variant)
        first_seed += [_task(study, case, tuple(group)) for group in groups.values()]
    return Plan([replace(task, seed=seed) for seed in seeds for task in first_seed], notes)


def _task(study: Study, case: Case, variants: tuple[Variant, ...]) -> Task:
    """Return the task of a case and variants that share their data, for seed 0."""
    parameters = study.parameters(case, variants[0])
    code = code_of(variants[0].kind)
    shared = {
        "format": FORMAT,
        "version": phd_jdtc_ros.__version__,
        "code": code,
        "case": case.name,
        "scenario": asdict(case.scenario),
        "classes": case.classes,
        "kind": variants[0].kind,
        "parameters": _in_force(parameters) if variants[0].kind == OURS else {},
        "ospa": [CUTOFF, ORDER, OTHER_CUTOFF, OTHER_ORDER],
    }
    digests = {
        v.name: _digest({**shared, "name": v.name, "reading": v.reading, "lags": v.lags})
        for v in variants
    }
    return Task(case.name, case.scenario, case.classes, variants, parameters, 0, code, digests)


def _in_force(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return every parameter that a tracker has, the defaults too."""
    values = tracker_config.resolve(parameters).values
    return {name: value for name, value in values.items() if name not in OWN}


def _digest(definition: Mapping[str, Any]) -> str:
    text = json.dumps(definition, sort_keys=True, default=np.ndarray.tolist)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def remaining(tasks: Iterable[Task], store: Store) -> list[Task]:
    """Return the tasks, each without the variants whose scores are stored."""
    rest = []
    for task in tasks:
        todo = tuple(v for v in task.variants if store.read(task, v) is None)
        if todo:
            rest.append(replace(task, variants=todo))
    return rest


def run_on_processes(
    tasks: Iterable[Task], workers: int, report: Report, work: Work = perform
) -> None:
    """Run tasks on processes of this machine.

    Parameters
    ----------
    tasks : iterable of Task
    workers : int
    report : callable of Outcome
        Called here, as the tasks end.
    work : callable
        What a worker does with a task.

    Notes
    -----
    When a process dies, whatever ran at that time is run again, one by one so that the guilty task
    is told from its neighbours; one that takes its process with it `TRIES` times has failed.
    """
    waiting = deque((task, 0) for task in tasks)
    suspects: deque[tuple[Task, int]] = deque()
    while waiting or suspects:
        queue, at_once = (suspects, 1) if suspects else (waiting, workers)
        with _pool(at_once) as pool:
            lost = _feed(pool, queue, at_once, report, work)
        for task, tries in lost:
            if tries + 1 < TRIES:
                suspects.append((task, tries + 1))
            else:
                report(Outcome(task, error=f"the worker process died, {TRIES} times"))


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool whose processes compute in one thread each and end with it, whatever happens."""
    before = set(multiprocessing.active_children())
    settings = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in settings.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _feed(
    pool: ProcessPoolExecutor,
    queue: deque[tuple[Task, int]],
    at_once: int,
    report: Report,
    work: Work,
) -> list[tuple[Task, int]]:
    """Work through a queue until it is empty or a process dies; return what was lost with it.

    No more is handed out than runs, so that little is suspected.
    """
    running: dict[Future[Outcome], tuple[Task, int]] = {}
    while queue or running:
        broken = False
        while queue and len(running) < at_once and not broken:
            try:
                running[_submit(pool, work, queue[0][0])] = queue[0]
                queue.popleft()
            except BrokenProcessPool:
                broken = True
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        lost = [_end(future, running, report) for future in ended]
        if broken or any(lost):
            # A broken pool ends all its futures.
            wait(running)
            lost += [_end(future, running, report) for future in list(running)]
            return [entry for entry in lost if entry is not None]
    return []


def _end(
    future: Future[Outcome], running: dict[Future[Outcome], tuple[Task, int]], report: Report
) -> tuple[Task, int] | None:
    """Report how a future ended; return its entry if its process died."""
    entry = running.pop(future)
    try:
        outcome = future.result()
    except BrokenProcessPool:
        return entry
    report(outcome)
    return None


def _submit(pool: ProcessPoolExecutor, work: Work, task: Task) -> Future[Outcome]:
    """Submit a task; a process that this starts never sees an interrupt from the keyboard."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(work, task)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_on_dask(tasks: Sequence[Task], address: str, report: Report, work: Work = perform) -> None:
    """Run tasks on a Dask cluster.

    Parameters
    ----------
    tasks : sequence of Task
    address : str
        Of the scheduler.
    report : callable of Outcome
        Called here, as the tasks end.
    work : callable
        What a worker does with a task.

    Raises
    ------
    ConfigError
        If Dask is not installed or nobody answers at the address.

    Notes
    -----
    The scheduler itself runs a lost worker's tasks again, and gives up on one that takes several
    workers with it.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise ConfigError(["--dask: needs the package distributed (the extra study)"]) from error
    try:
        client = Client(address, timeout=DASK_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ConfigError([f"--dask: {address!r} given, nobody answers: {error}"]) from error
    with client:
        futures = {client.submit(work, task, pure=False): task for task in tasks}
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except Exception as error:
                outcome = Outcome(futures[future], error=f"{type(error).__name__}: {error}")
            report(outcome)
            # Lets the cluster forget the result.
            future.release()


# --- results --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """All runs of a variant at a case.

    Parameters
    ----------
    case : str
    variant : Variant
    seeds : tuple of int
    scores : Scores
        Values of shape (runs, lags, scans, sets, VALUES).
    """

    case: str
    variant: Variant
    seeds: tuple[int, ...]
    scores: Scores

    def value(self, name: str, lag: int, of_set: str = ALL) -> FloatArray:
        """Return one of `VALUES`, shape (runs, scans)."""
        row, column = self.scores.lags.index(lag), self.scores.sets.index(of_set)
        found: FloatArray = self.scores.values[:, row, :, column, VALUES.index(name)]
        return found

    def figure(self, name: str, lag: int, of_set: str = ALL) -> FloatArray | None:
        """Return one of `FIGURES` of every run, shape (runs,); None if it has no meaning."""
        if name == "cardinality_abs_error":
            error = self.value("n_est", lag, of_set) - self.value("n_true", lag, of_set)
            return np.abs(error).mean(axis=1)
        if name == "class_accuracy":
            pairs = self.value("pairs", lag, of_set).sum(axis=1)
            right = self.value("right_class", lag, of_set).sum(axis=1)
            return np.divide(right, pairs, out=np.full(len(pairs), np.nan), where=pairs > 0)
        if name == "reduction":
            if lag == 0 or 0 not in self.scores.lags:
                return None
            after, before = (self.value("ospa", k, of_set).mean(axis=1) for k in (lag, 0))
            ratio = np.divide(after, before, out=np.full(len(after), np.nan), where=before > 0.0)
            return 1.0 - ratio
        return self.value(name, lag, of_set).mean(axis=1)


class Mean(NamedTuple):
    """A mean over runs and half the width of its 95 % interval; NaN where not known."""

    mean: float
    half_width: float

    @staticmethod
    def of(runs: FloatArray | None) -> Mean:
        """Return the mean of independent runs, by Student's t; NaNs do not count."""
        known = np.zeros(0) if runs is None else runs[np.isfinite(runs)]
        count = len(known)
        if count < 2:
            return Mean(float(known[0]) if count else math.nan, math.nan)
        error = known.std(ddof=1) / math.sqrt(count)
        return Mean(float(known.mean()), float(stats.t.ppf(0.975, count - 1) * error))

    def as_json(self) -> dict[str, Any] | None:
        """Return the mean and its interval; None stands for what is not known."""
        if math.isnan(self.mean):
            return None
        low, high = self.mean - self.half_width, self.mean + self.half_width
        interval = None if math.isnan(self.half_width) else [low, high]
        return {"mean": self.mean, "interval_95": interval}


def _stored(tasks: Iterable[Task]) -> dict[tuple[str, str], list[tuple[Task, Variant]]]:
    """Return what may be stored of a plan, by the names of case and variant."""
    found: dict[tuple[str, str], list[tuple[Task, Variant]]] = {}
    for task in tasks:
        for variant in task.variants:
            found.setdefault((task.case, variant.name), []).append((task, variant))
    return found


def collect(tasks: Iterable[Task], store: Store) -> list[Result]:
    """Return all stored results of a plan's tasks, by case and then variant."""
    results = []
    for (case, _), entries in _stored(tasks).items():
        runs = [(task.seed, store.read(task, variant)) for task, variant in entries]
        known = [(seed, scores) for seed, scores in runs if scores is not None]
        if known:
            values = np.stack([scores.values for _, scores in known])
            scores = known[0][1]._replace(values=values)
            seeds = tuple(seed for seed, _ in known)
            results.append(Result(case, entries[0][1], seeds, scores))
    return results


def write_csv(path: Path, tasks: Iterable[Task], store: Store) -> None:
    """Write all stored rows of a plan's tasks into one file, by case, variant and seed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        file.write((",".join(HEADER) + "\n").encode())
        for entries in _stored(tasks).values():
            for task, variant in entries:
                with contextlib.suppress(FileNotFoundError):
                    rows = gzip.decompress(store.path(task, variant).read_bytes())
                    file.write(rows.partition(b"\n")[2])
    os.replace(temporary, path)


def summarise(
    study: Study, results: Sequence[Result], notes: Sequence[str], failures: Sequence[Outcome]
) -> dict[str, Any]:
    """Return a study's figures, as `summary.json` holds them.

    Parameters
    ----------
    study : Study
    results : sequence of Result
    notes : sequence of str
        What was left out.
    failures : sequence of Outcome
        What failed.

    Returns
    -------
    dict
        ``cases`` by case, variant, lag and set: the mean over runs of each of `FIGURES` with its
        95 % interval, None where it has no meaning. ``reduction`` is that of the mean OSPA against
        lag 0 of the same variant and seed.
    """
    cases: dict[str, Any] = {}
    for result in results:
        cases.setdefault(result.case, {})[result.variant.name] = {
            "runs": len(result.seeds),
            "seeds": list(result.seeds),
            "lags": {
                str(lag): {
                    key: {f: Mean.of(result.figure(f, lag, key)).as_json() for f in FIGURES}
                    for key in result.scores.sets
                }
                for lag in result.scores.lags
            },
        }
    return {
        "p": ORDER,
        "c": CUTOFF,
        "cases": cases,
        "goals": [_judged(goal, results) for goal in study.goals],
        "notes": list(notes),
        "failed": [
            {
                "case": outcome.task.case,
                "variants": [variant.name for variant in outcome.task.variants],
                "seed": outcome.task.seed,
                "error": outcome.error.strip().splitlines()[-1],
            }
            for outcome in failures
        ],
    }


def _judged(goal: Goal, results: Sequence[Result]) -> dict[str, Any]:
    """Return a goal with what was reached; None where the study has no such figure."""
    value = _mean(goal, goal.variant, results)
    bound = goal.bound
    if goal.relative_to is not None:
        bound *= _mean(goal, goal.relative_to, results)
    reached = value <= bound if goal.at_most else value >= bound
    known = math.isfinite(value) and math.isfinite(bound)
    return {
        "name": goal.name,
        "value": value if math.isfinite(value) else None,
        "goal": bound if math.isfinite(bound) else None,
        "at_most": goal.at_most,
        "reached": reached if known else None,
    }


def _mean(goal: Goal, variant: str, results: Sequence[Result]) -> float:
    for result in results:
        here = (result.case, result.variant.name) == (goal.case, variant)
        if here and goal.lag in result.scores.lags:
            return Mean.of(result.figure(goal.figure, goal.lag)).mean
    return math.nan
