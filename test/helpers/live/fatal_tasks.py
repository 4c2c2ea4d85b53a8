"""Work for the study's processes that ends them; they import it from here, and nothing heavy."""

import os
import signal
import time
from functools import partial
from types import SimpleNamespace


def tasks(count):
    """Return tasks that are no more than their seeds."""
    return [SimpleNamespace(seed=seed) for seed in range(count)]


def outcome(task, error=""):
    return SimpleNamespace(task=task, error=error)


def die_once(marker, seed, task):
    """Kill the process at the first task of a seed."""
    if task.seed == seed and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome(task)


def die_of_one(seed, marker, other, task):
    """Kill the process at every task of a seed, and at the first one of another."""
    if task.seed == seed:
        os.kill(os.getpid(), signal.SIGKILL)
    return die_once(marker, other, task)


def alone(active, task):
    """Return an error if another task is running."""
    try:
        active.touch(exist_ok=False)
    except FileExistsError:
        return outcome(task, error="another task is running")
    time.sleep(0.05)
    active.unlink()
    return outcome(task)


def interrupt_a_worker_that_sends(marker):
    """Interrupt a pool of three while a worker waits to send the rest of its outcome."""
    from phd_jdtc_ros.study import tasks as study_tasks

    def report(_):
        wait_for(marker)
        time.sleep(0.5)
        raise KeyboardInterrupt

    study_tasks.run_on_processes(tasks(3), 3, report, partial(_fill_the_pipe, marker))


class _ReadSlowly:
    """An outcome that keeps the thread which receives it for a while."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return _read, (self.marker,)


def _read(marker):
    marker.touch()
    time.sleep(2.0)


def _fill_the_pipe(marker, task):
    if task.seed == 1:
        return _ReadSlowly(marker)
    if task.seed == 2:
        wait_for(marker)
        return bytes(1_000_000)
    return outcome(task)


def wait_for(marker):
    deadline = time.monotonic() + 60.0
    while not marker.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
