"""Comparison of estimates with truth: per scan, and over a run.

::

    truth, estimates (PointSet): pairs by stamp    run_scores: its cut-off and order too
      |  by position alone                         comparison, metrics
    PairedScan
      |  split: all targets, each class            comparison
    Comparison
      |  values of a scan                          distances, tracks, consistency
    ScanScore                                      run_scores
      |  totals over the run                       run_scores, accumulator
    figures per run                                the same

An `accumulator` computes values of scans and defines the metrics derived from them, each with its
heading, unit, format and definition; `run_scores` collects the metrics.
"""
