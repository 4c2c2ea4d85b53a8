# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Estimates against truth: by scan, and over a run.

::

    truth, estimates (PointSet)
      |  distances and assignment            metrics
    Score of a scan, all and by class        scan_scores
      |  tracks, gaps, confusion             surveillance
      |  sums over the run                   run_scores
    Evaluation: pairs both by stamp          evaluation
"""
