import os
import subprocess
import sys
import textwrap
from functools import partial
from pathlib import Path

import fatal_tasks
import numpy as np
from fatal_tasks import alone, die_of_one, die_once, outcome
from fatal_tasks import tasks as light_tasks

from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import execution
from phd_jdtc_ros.study.monte_carlo.tasks import perform


def on_processes(tasks, report, *work):
    monte_carlo.run_on_processes(tasks, 2, report, *work)


def seeds(outcomes):
    assert not any(outcome.error for outcome in outcomes)
    return sorted(outcome.task.seed for outcome in outcomes)


def test_dask_workers_do_what_perform_does(cluster, tasks):
    """Those of a pool do too: see `test_main_gives_the_same_bytes_however_it_is_run`."""
    found = []
    monte_carlo.run_on_dask(tasks, cluster, found.append)

    assert seeds(found) == [0, 1]
    for each in found:
        expected = perform(each.task).scores["corrected"].values
        np.testing.assert_array_equal(each.scores["corrected"].values, expected)


def test_dask_runs_a_dead_workers_tasks_again(cluster, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died", 1)
    monte_carlo.run_on_dask(light_tasks(5), cluster, found.append, work)

    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]


def test_run_on_processes_leaves_a_processor_to_what_takes_it(tmp_path):
    found = []
    work = partial(alone, tmp_path / "active")
    monte_carlo.run_on_processes(light_tasks(4), 2, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 1, 2, 3]
    # However much is taken, one worker goes on.
    monte_carlo.run_on_processes(light_tasks(1), 1, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 0, 1, 2, 3]


def test_run_on_processes_runs_lost_tasks_again_and_gives_up_on_the_guilty_one_alone(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(execution, "TRIES", 2)
    found = []
    work = partial(die_of_one, 1, tmp_path / "died", 3)
    on_processes(light_tasks(4), found.append, work)

    assert (tmp_path / "died").exists()
    (failed,) = [outcome for outcome in found if outcome.error]
    found.remove(failed)
    assert seeds(found) == [0, 2, 3]
    assert failed.task.seed == 1
    assert "died" in failed.error


def test_run_on_processes_is_interrupted_while_a_worker_sends_an_outcome(tmp_path):
    script = f"""
        from pathlib import Path
        from fatal_tasks import interrupt_a_worker_that_sends
        if __name__ == "__main__":
            interrupt_a_worker_that_sends(Path({str(tmp_path / "marker")!r}))
    """
    (tmp_path / "main.py").write_text(textwrap.dedent(script))
    path = os.pathsep.join([str(Path(fatal_tasks.__file__).parent), str(Path(__file__).parents[2])])
    ended = subprocess.run(
        [sys.executable, tmp_path / "main.py"],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        timeout=60,
        check=False,
    )

    assert ended.stderr.decode().strip().endswith("KeyboardInterrupt")


def test_run_on_processes_restores_the_environment(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)

    on_processes(light_tasks(1), lambda _: None, outcome)

    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ
