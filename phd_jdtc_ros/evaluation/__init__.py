"""Comparison of estimates with truth: per scan, and over a run.

::

    truth, estimates (PointSet): pairs by stamp    evaluation, true_tracks
      |  by position alone                         comparison, metrics
    PairedScan
      |  of all targets, and of each class         comparison
    Comparison
      |  values of a scan                          accumulators
    ScanScore                                      run_scores
      |  totals over the run                       run_scores, totals
    figures per run                                accumulators, metric_table

An `accumulator` has the values of scans and the metrics that are made of them, each with its
heading, unit, format and definition; `metric_table` collects them.
"""
