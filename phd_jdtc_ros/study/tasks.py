"""The tasks of a study: plan, digests, execution in processes or on a Dask cluster, scores on disk.

The scores of each case, variant and seed are a file of tidy rows.
"""

from __future__ import annotations

import contextlib
import csv
import gzip
import hashlib
import io
import json
import math
import multiprocessing
import os
import re
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

import phd_jdtc_ros
from phd_jdtc_ros import output_files
from phd_jdtc_ros.configuration import build as tracker_config
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.evaluation.comparison import PairedScan, PointSet, set_names
from phd_jdtc_ros.evaluation.distances import confusion_matrix
from phd_jdtc_ros.evaluation.run_scores import ScanComparer
from phd_jdtc_ros.simulation.scenario import Scenario

from .definition import CUTOFF, ORDER, OWN, Case, Kind, Study, Variant, code_of
from .metrics import OTHER_CUTOFF, OTHER_ORDER, VALUES, new_accumulators
from .tracker import (
    TAXIING,
    IgnoredTargets,
    SimulatedRun,
    TrackingResult,
    Tracks,
    simulated_run,
    turning_run,
)


class Scores(NamedTuple):
    """The scores of one variant in one or several runs."""

    lags: tuple[int, ...]
    sets: tuple[str, ...]  # ``all`` and, for trackers with classes, one ``class_k`` per class
    time_s: FloatArray  # Time since the first scan, seconds, (scans,)
    values: FloatArray  # NaN for missing values, (..., lags, scans, sets, VALUES)
    # Number of pairs by [true class, estimated class], (..., lags, scans, C, C); None for trackers
    # without classes.
    taken_for: IntArray | None = None


def score(
    run: SimulatedRun,
    tracks: Tracks,
    variant: Variant,
    classes: int,
    cutoff: float = CUTOFF,
    cpu_ms: float = math.nan,
) -> Scores:
    """Return the scores of a variant at the lags that its tracker supports.

    The cutoff is c of OSPA and GOSPA, metres, and `cpu_ms` the CPU time per revolution,
    milliseconds, NaN if unknown. Values are rounded to a thousandth, so that files are short and
    values are read back exactly. The values of gaps count the gaps that ended in the scan; all gaps
    end in the last scan.
    """
    lags = tuple(lag for lag in variant.lags if lag in tracks)
    if not lags:
        raise ValueError(f"lags: {variant.lags} requested, the tracker has {sorted(tracks)}")
    scans = len(run.truth)
    estimated = classes if variant.kind.classes else 0
    sets = set_names(estimated)
    values = np.full((len(lags), scans, len(sets), len(VALUES)), np.nan)
    taken_for = np.zeros((len(lags), scans, estimated, estimated), dtype=np.int64)
    for row, lag in enumerate(lags):
        comparer = ScanComparer(estimated, new_accumulators(cutoff, ORDER, run, cpu_ms))
        for index, (truth, points) in enumerate(zip(run.truth, tracks[lag], strict=True)):
            scan = PairedScan.of(truth.stamp_ns, PointSet.of(truth), points, cutoff)
            found = comparer.compare(scan)
            if index == scans - 1:
                found = comparer.final_values()
            values[row, index] = [list(of_set.values()) for of_set in found.values()]
            matrix = confusion_matrix(scan.pairs, truth.class_id, points.class_id, estimated)
            taken_for[row, index] = matrix[:estimated, :estimated]
    stamps = np.array([truth.stamp_ns - run.truth[0].stamp_ns for truth in run.truth])
    return Scores(lags, sets, stamps * 1e-9, np.round(values, 3), taken_for if estimated else None)


# The last column is a class's row of `Scores.taken_for`: numbers separated by blanks.
HEADER = ("case", "variant", "lag", "seed", "scan", "time_s", "set", *VALUES, "taken_for")


@dataclass(frozen=True)
class Store:
    """Scores on disk, a file for each case, variant and seed."""

    directory: Path  # Created if necessary

    def path(self, task: Task, variant: Variant) -> Path:
        """Return the path of a variant's scores, with a digest of all their inputs."""
        digest = task.digests[variant.name]
        name = f"{slug(task.case)}.{slug(variant.name)}.{task.seed}.{digest}.csv.gz"
        return self.directory / name

    def write(self, task: Task, variant: Variant, scores: Scores) -> None:
        """Write scores atomically."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(_rows(task, variant, scores))
        self.directory.mkdir(parents=True, exist_ok=True)
        # The gzip header has no time stamp, so that equal scores give equal bytes.
        output_files.write(
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
    for row, lag in enumerate(scores.lags):
        for scan, time in enumerate(scores.time_s):
            taken = [] if scores.taken_for is None else scores.taken_for[row, scan].tolist()
            # The first set, of all targets, has no class.
            texts = ["", *(" ".join(map(str, counts)) for counts in taken)]
            for name, values, text in zip(
                scores.sets, scores.values[row, scan], texts, strict=True
            ):
                fixed = [task.case, variant.name, lag, task.seed, scan, round(time, 9), name]
                yield [*fixed, *map(_cell, values.tolist()), text]


def _cell(value: float) -> str:
    """Return a value as text of 15 digits, which restores values of three decimals exactly."""
    return "" if math.isnan(value) else f"{value:.15g}"


def _scores(rows: Sequence[Sequence[str]]) -> Scores:
    lags = tuple(dict.fromkeys(int(row[2]) for row in rows))
    times = list(dict.fromkeys(row[5] for row in rows))
    sets = tuple(dict.fromkeys(row[6] for row in rows))
    values = np.array([[float(cell or "nan") for cell in row[7:-1]] for row in rows])
    shape = (len(lags), len(times), len(sets), len(VALUES))
    classes = len(sets) - 1
    taken_for = None
    if classes:
        counts = [[int(cell) for cell in row[-1].split()] for row in rows if row[-1]]
        taken_for = np.array(counts).reshape(len(lags), len(times), classes, classes)
    return Scores(lags, sets, np.array(times, dtype=float), values.reshape(shape), taken_for)


def remaining(tasks: Iterable[Task], store: Store) -> list[Task]:
    """Return the remaining tasks, each without the variants whose scores are stored."""
    rest = []
    for task in tasks:
        unscored = tuple(v for v in task.variants if store.read(task, v) is None)
        if unscored:
            rest.append(replace(task, variants=unscored))
    return rest


def slug(name: str) -> str:
    """Return a file name that is valid on all file systems."""
    return re.sub(r"[^\w]+", "_", name)


@dataclass(frozen=True)
class Task:
    """One seeded run of variants that share data and, for this package's engines, one filter."""

    case: str
    scenario: Scenario
    classes: int
    variants: tuple[Variant, ...]  # All of one kind
    parameters: dict[str, Any]  # Parameters of the tracker
    seed: int
    code: str  # Digest of the tracker's code, see `code_of`
    # Digest of all inputs of a variant's scores except the seed, by name of the variant.
    digests: dict[str, str]
    cutoff: float  # The c of OSPA and GOSPA, metres
    ignored: IgnoredTargets = TAXIING  # Unscored targets if antennas turn

    @property
    def kind(self) -> Kind:
        """The common kind of the variants."""
        return self.variants[0].kind

    @property
    def label(self) -> str:
        """The case, variants and seed of the task, for messages."""
        return f"{self.case}, {' + '.join(v.name for v in self.variants)}, seed {self.seed}"


@dataclass(frozen=True)
class Outcome:
    """The outcome of a task: scores or an error."""

    task: Task
    # Scores by name of the variant; empty if the task failed.
    scores: dict[str, Scores] = field(default_factory=dict)
    error: str = ""  # Empty if the task succeeded


class Plan(NamedTuple):
    """The tasks of a study."""

    # Ordered by seed, so that a study stopped early has results of all variants. A reduced number
    # of runs uses the first seeds.
    tasks: list[Task]
    notes: list[str]  # Omitted variants, with the reasons


def plan(study: Study, seeds: Sequence[int]) -> Plan:
    """Return all tasks of a study."""
    left_out = dict(study.left_out)
    left_out |= {v.name: reason for v in study.variants if (reason := v.kind.missing()) is not None}
    notes = [f"{name}: left out, {reason}" for name, reason in left_out.items()]
    first_seed: list[tuple[Task, int]] = []
    for case in study.cases:
        groups: dict[tuple[str, int], list[Variant]] = {}
        for one in study.variants:
            variant = replace(one, lags=case.lags_of(one))
            if case.name in variant.cases and variant.name not in left_out:
                # Only variants of this package's tracker can share a filter.
                name = "" if variant.kind.is_engine else variant.name
                key = json.dumps([variant.kind.name, name, variant.parameters], sort_keys=True)
                runs = study.runs(case, variant, len(seeds))
                groups.setdefault((key, runs), []).append(variant)
        first_seed += [
            (_task(study, case, tuple(group)), runs) for (_, runs), group in groups.items()
        ]
    tasks = [
        replace(task, seed=seed)
        for index, seed in enumerate(seeds)
        for task, runs in first_seed
        if index < runs
    ]
    return Plan(tasks, notes)


def _task(study: Study, case: Case, variants: tuple[Variant, ...]) -> Task:
    """Return the task of a case and of variants that share their data, for seed 0."""
    parameters = study.parameters(case, variants[0])
    kind = variants[0].kind
    code, values = code_of(kind), tracker_config.resolve(parameters).values
    in_force = {name: value for name, value in values.items() if name not in OWN}
    shared = {
        # Version of the stored rows; increase it when their meaning changes.
        "format": 5,
        "version": phd_jdtc_ros.__version__,
        "code": code,
        "case": case.name,
        "scenario": asdict(case.scenario),
        "classes": case.classes,
        "kind": kind.name,
        "parameters": {} if kind.known_association else in_force,
        "ospa": [study.cutoff_of(case), ORDER, OTHER_CUTOFF, OTHER_ORDER],
        "ignored": case.ignored,
    }
    digests = {v.name: _digest({**shared, "name": v.name, "lags": v.lags}) for v in variants}
    settings = case.name, case.scenario, case.classes, variants, parameters
    return Task(*settings, 0, code, digests, study.cutoff_of(case), case.ignored)


def _digest(definition: Mapping[str, Any]) -> str:
    text = json.dumps(definition, sort_keys=True, default=np.ndarray.tolist)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def perform(task: Task) -> Outcome:
    """Run a task; the outcome records an exception."""
    try:
        if code_of(task.kind) != task.code:
            raise RuntimeError("the worker's code differs from the study's; start the study again")
        if task.scenario.turning:
            run = turning_run(task.scenario, task.seed, task.ignored)
        else:
            run = simulated_run(task.scenario, task.seed)
        tracked = _track_variants(task, run)
        scores = {
            variant.name: score(run, found.tracks, variant, task.classes, task.cutoff, found.cpu_ms)
            for variant in task.variants
            for found in (tracked[variant.name],)
        }
    except Exception:
        return Outcome(task, error=traceback.format_exc())
    return Outcome(task, scores)


def _track_variants(task: Task, run: SimulatedRun) -> dict[str, TrackingResult]:
    lags = sorted({lag for variant in task.variants for lag in variant.lags})
    if task.kind.is_engine:
        # An engine loads compiled code, so that only its runs import it.
        from .tracker import track

        found = TrackingResult(track(run, tracker_config.resolve(task.parameters), lags))
        return dict.fromkeys([variant.name for variant in task.variants], found)
    if task.kind.track is None:
        raise ValueError(f"kind: {task.kind.name} given, {task.kind.missing()}")
    tracked = task.kind.track(run, task.parameters, lags)
    return {variant.name: tracked for variant in task.variants}


# A task fails after this many deaths of its worker process.
TRIES = 3
DASK_TIMEOUT_S = 10

Report: TypeAlias = Callable[[Outcome], None]
Work: TypeAlias = Callable[[Task], Outcome]


def run_on_processes(
    tasks: Iterable[Task],
    workers: int,
    report: Report,
    work: Work = perform,
    busy: Callable[[], int] = lambda: 0,
) -> None:
    """Run tasks in local processes; `report` is called in this process whenever a task ends.

    A worker calls `work` with a task. `busy` returns the number of the workers' processors that
    other processes use; this many workers wait, but never all.

    When a process dies, all tasks that were running are repeated one at a time, to find the task
    that causes it. A task whose process dies `TRIES` times has failed.
    """
    waiting = deque((task, 0) for task in tasks)
    suspects: deque[tuple[Task, int]] = deque()
    while waiting or suspects:
        queue, at_once = (suspects, 1) if suspects else (waiting, workers)
        with _pool(at_once) as pool:
            lost = _feed(pool, queue, at_once, busy, report, work)
        for task, tries in lost:
            if tries + 1 < TRIES:
                suspects.append((task, tries + 1))
            else:
                report(Outcome(task, error=f"the worker process died, {TRIES} times"))


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of processes, which end with the context even after an error."""
    before = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=spawn, initializer=_Worker.begin)
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


class _Worker:
    """A worker process on SIGTERM: it ends in its task, but not while it sends an outcome.

    This process would wait for the rest of an outcome for ever.
    """

    terminated = False
    performing = False

    @classmethod
    def begin(cls) -> None:
        """Handle SIGTERM from now on."""
        signal.signal(signal.SIGTERM, cls._terminate)

    @classmethod
    def perform(cls, work: Work, task: Task) -> Outcome:
        """Return the outcome of a task, unless SIGTERM comes before it is there."""
        cls.performing = True
        if cls.terminated:
            os._exit(1)
        try:
            return work(task)
        finally:
            cls.performing = False

    @classmethod
    def _terminate(cls, number: int, frame: FrameType | None) -> None:
        cls.terminated = True
        if cls.performing:
            os._exit(1)


def _feed(
    pool: ProcessPoolExecutor,
    queue: deque[tuple[Task, int]],
    most: int,
    busy: Callable[[], int],
    report: Report,
    work: Work,
) -> list[tuple[Task, int]]:
    """Run a queue until it is empty or a process dies; return the tasks lost with the process.

    The number of submitted tasks equals the number of workers, so that few tasks are lost.
    """
    running: dict[Future[Outcome], tuple[Task, int]] = {}
    while queue or running:
        broken = False
        while queue and len(running) < max(most - busy(), 1) and not broken:
            try:
                running[_submit(pool, work, queue[0][0])] = queue[0]
                queue.popleft()
            except BrokenProcessPool:
                broken = True
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        lost = [_end(future, running, report) for future in ended]
        if broken or any(lost):
            # All futures of a broken pool end.
            wait(running)
            lost += [_end(future, running, report) for future in list(running)]
            return [entry for entry in lost if entry is not None]
    return []


def _end(
    future: Future[Outcome], running: dict[Future[Outcome], tuple[Task, int]], report: Report
) -> tuple[Task, int] | None:
    """Report the outcome of a future; return its entry if its process died."""
    entry = running.pop(future)
    try:
        outcome = future.result()
    except BrokenProcessPool:
        return entry
    report(outcome)
    return None


def _submit(pool: ProcessPoolExecutor, work: Work, task: Task) -> Future[Outcome]:
    """Submit a task; processes started for it ignore keyboard interrupts."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.submit(_Worker.perform, work, task)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_on_dask(tasks: Sequence[Task], address: str, report: Report, work: Work = perform) -> None:
    """Run tasks on the Dask cluster of a scheduler's address; see `run_on_processes`.

    The scheduler repeats the tasks of a dead worker. It gives up on a task after several workers
    have died. Raise `ConfigError` if Dask is not installed or no scheduler answers at the address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise ConfigError("--dask: needs the package distributed (the extra study)") from error
    try:
        client = Client(address, timeout=DASK_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--dask: {address!r} given, no scheduler answers: {error}") from error
    with client:
        futures = {client.submit(work, task, pure=False): task for task in tasks}
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except Exception as error:
                outcome = Outcome(futures[future], error=f"{type(error).__name__}: {error}")
            report(outcome)
            # This frees the result's memory on the cluster.
            future.release()
