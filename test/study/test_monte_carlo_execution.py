import os
from dataclasses import replace
from functools import partial

import numpy as np
from fatal_tasks import alone, die_of_one, die_once

from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import Outcome, execution
from phd_jdtc_ros.study.monte_carlo.tasks import perform


def many(tasks, count):
    return [replace(tasks[0], seed=seed) for seed in range(count)]


def seeds(outcomes):
    return sorted(outcome.task.seed for outcome in outcomes)


def test_run_on_processes_does_what_perform_does(tasks):
    found = []
    monte_carlo.run_on_processes(tasks, 2, found.append)

    assert [outcome.error for outcome in found] == ["", ""]
    for outcome in found:
        expected = perform(outcome.task).scores["corrected"].values
        np.testing.assert_array_equal(outcome.scores["corrected"].values, expected)


def test_run_on_processes_leaves_a_processor_to_what_takes_it(tasks, tmp_path):
    found = []
    work = partial(alone, tmp_path / "active")
    monte_carlo.run_on_processes(many(tasks, 4), 2, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 1, 2, 3]
    # However much is taken, one worker goes on.
    monte_carlo.run_on_processes(many(tasks, 1), 1, found.append, work, busy=lambda: 1)
    assert seeds(found) == [0, 0, 1, 2, 3]
    assert not any(outcome.error for outcome in found)


def test_run_on_processes_runs_a_dead_workers_tasks_again(tasks, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died")
    monte_carlo.run_on_processes(many(tasks, 5), 2, found.append, work)

    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]
    assert not any(outcome.error for outcome in found)


def test_run_on_processes_gives_up_on_the_guilty_task_alone(tasks, monkeypatch):
    monkeypatch.setattr(execution, "TRIES", 2)
    found = []
    monte_carlo.run_on_processes(many(tasks, 4), 2, found.append, partial(die_of_one, 1))

    assert seeds(found) == [0, 1, 2, 3]
    (failed,) = [outcome for outcome in found if outcome.error]
    assert failed.task.seed == 1
    assert "died" in failed.error


def test_run_on_processes_restores_the_environment(tasks, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)

    monte_carlo.run_on_processes(tasks[:1], 1, lambda _: None, Outcome)

    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_run_on_dask_does_what_perform_does(cluster, tasks):
    found = []
    monte_carlo.run_on_dask(tasks, cluster, found.append)

    assert [outcome.error for outcome in found] == ["", ""]
    for outcome in found:
        expected = perform(outcome.task).scores["corrected"].values
        np.testing.assert_array_equal(outcome.scores["corrected"].values, expected)


def test_run_on_dask_runs_a_dead_workers_tasks_again(cluster, tasks, tmp_path):
    found = []
    work = partial(die_once, tmp_path / "died")
    monte_carlo.run_on_dask(many(tasks, 5), cluster, found.append, work)

    assert (tmp_path / "died").exists()
    assert seeds(found) == [0, 1, 2, 3, 4]
    assert not any(outcome.error for outcome in found)
