"""Work for the study's processes that ends them; they import it from here."""

import os
import signal
import time

from phd_jdtc_ros.study.monte_carlo import Outcome


def die_once(marker, task):
    """Kill the process at the first task of seed 1."""
    if task.seed == 1 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(task)


def die_of_one(seed, task):
    if task.seed == seed:
        os.kill(os.getpid(), signal.SIGKILL)
    return Outcome(task)


def alone(active, task):
    """Return an error if another task is running."""
    try:
        active.touch(exist_ok=False)
    except FileExistsError:
        return Outcome(task, error="another task is running")
    time.sleep(0.05)
    active.unlink()
    return Outcome(task)
