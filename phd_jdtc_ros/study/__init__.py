"""The Monte Carlo study: the tracker, a reference and other trackers on the same simulated runs.

The steps, with the module of each::

    study file (YAML, read elsewhere)
      |  resolve: all faults at once              document
    Study: cases x variants, goals                definition
      |  plan                                     tasks
    Task: a case, variants that share a filter, and a seed
      |  remaining: tasks without scores          tasks
      |  run_on_processes, run_on_dask:           tasks
      |    tasks of dead workers again
      |  perform: simulate, track, score          tasks
      |    scenario and seed: truth, scans        tracker
      |    this package's tracker                 tracker
      |    the model-matched reference            reference
      |    score each run                         metrics
    Store: tidy rows by case, variant, seed       tasks
      |  collect, write_csv, summarise            results
    results.csv, summary.json
      |  draw, tabulate                           figures
    pictures, tables

The data of a run depend on case and seed alone, so that all variants of a case have the same scans
and differences between them are paired. The name of a score file contains a digest of all inputs of
the scores, including the code of the tracker. The repository's folder `studies` has other trackers,
and studies of single questions that use these modules.
"""
