"""A Monte Carlo study: many seeded runs of several trackers on several scenarios, and their scores.

The steps of a study, with the module of each::

    study file (YAML, read elsewhere)
      |  resolve: all faults at once         document
    Study: cases x variants, goals           definition
      |  plan                                tasks
    Task ...                                 tasks
      |  remaining: tasks without scores     store
      |  run_on_processes, run_on_dask:      execution
      |    tasks of dead workers again
      |  perform: simulate, track, score     tasks, definition
    Outcome                                  tasks
      |  write                               store
    Store: tidy rows by case, variant, seed  store
      |  collect, write_csv, summarise       results
    results.csv, summary.json

A task is a case, variants that share a filter, and a seed. The data of a run depend on case and
seed alone, so that all variants of a case have the same scans and differences between them are
paired. The name of a score file contains a digest of all inputs of the scores, including the code
of the tracker (`definition`).
"""

from phd_jdtc_ros.evaluation.comparison import ALL

from .definition import KINDS, Kind, Study
from .document import REFERENCE, Scene, resolve
from .execution import Report, run_on_dask, run_on_processes
from .results import Mean, Result, collect, summarise, write_csv
from .tasks import Outcome, Plan, Store, Task, plan, remaining, slug

__all__ = [
    "ALL",
    "KINDS",
    "REFERENCE",
    "Kind",
    "Mean",
    "Outcome",
    "Plan",
    "Report",
    "Result",
    "Scene",
    "Store",
    "Study",
    "Task",
    "collect",
    "plan",
    "remaining",
    "resolve",
    "run_on_dask",
    "run_on_processes",
    "slug",
    "summarise",
    "write_csv",
]
