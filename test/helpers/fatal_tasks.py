"""Work for the study's processes that ends them; they import it from here, and nothing heavy."""

import os
import signal
import time
from types import SimpleNamespace


def tasks(count):
    """Return tasks that are no more than their seeds."""
    return [SimpleNamespace(seed=seed) for seed in range(count)]


def outcome(task, error=""):
    return SimpleNamespace(task=task, error=error)


def die_once(marker, task):
    """Kill the process at the first task of seed 1."""
    if task.seed == 1 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome(task)


def die_of_one(seed, task):
    if task.seed == seed:
        os.kill(os.getpid(), signal.SIGKILL)
    return outcome(task)


def alone(active, task):
    """Return an error if another task is running."""
    try:
        active.touch(exist_ok=False)
    except FileExistsError:
        return outcome(task, error="another task is running")
    time.sleep(0.05)
    active.unlink()
    return outcome(task)
