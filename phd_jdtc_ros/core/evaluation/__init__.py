# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Estimates against truth: by scan, and over a run.

::

    truth, estimates (PointSet): pairs by stamp    evaluation
      |  by position alone                         scan_scores, metrics
    PairedScan
      |  distances, gaps, tracks, by set           scan_scores, metrics, surveillance
    Comparison, of all targets and of each class   scan_scores
      |  values of a scan                          metric_table
    ScanScore                                      scan_scores
      |  totals over the run                       run_scores, totals
    figures of a run                               metric_table

What metrics there are, how they are computed, written and defined is said in `metric_table` alone.
"""
