# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tracker's mathematics: no ROS, no files, numpy and scipy only.

The data's path, with the room or module of each step::

    reports (radar, stamp, Detections)         types
      |  cut turns into slices, coverage       turns, antenna
      |  group by stamp, gaps, resets          scans
    Scan                                       pipeline: turns -> scans -> engine -> events
      |  predict, update with every radar      an engine: smc (particles)
      |    motion, radars, amplitudes, births    models
      |    gating                              pair_search
      |    association probabilities           association
      |------------- extract ---------------> Estimates (filtered), numbered by track_numbers
      |                                        and brought to one stamp by reporting
      |  backward over the lag window          the engine
      |------------- extract ---------------> Estimates (smoothed)

`engine` is the interface of all engines, and `engines` creates one by its name. `configuration`
turns parameters into models and settings. `simulation` makes scans with known truth, and
`evaluation` compares estimates with it. `gaussian` is the Kalman filter and smoother of single
tracks, which the study's reference uses.

Packages import in one direction only::

    pipeline -> engines -> configuration -> smc, gaussian -> association, models, pair_search
    evaluation, simulation -> models          everything -> types, state_space, arrays, quoting

The method is that of Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's. Where the code
departs from the paper, the docstring says so under "Deviation".
"""
