"""Comparison of estimates with truth: per scan, and over a run.

::

    truth, estimates (PointSet): pairs by stamp    evaluation, true_tracks
      |  by position alone                         scan_scores, metrics
    PairedScan
      |  distances, gaps, tracks, per set          scan_scores, metrics, surveillance, consistency
    Comparison, of all targets and of each class   scan_scores
      |  values per scan                           metric_table
    ScanScore                                      scan_scores
      |  totals over the run                       run_scores, totals
    figures per run                                metric_table

`metric_table` alone lists the metrics, with their computation, format and definition.
"""
