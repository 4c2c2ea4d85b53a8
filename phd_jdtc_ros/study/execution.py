"""Parallel execution of tasks in local processes or on a Dask cluster."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from types import FrameType
from typing import TypeAlias

from phd_jdtc_ros.configuration.schema import ConfigError

from .tasks import Outcome, Task, perform

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
