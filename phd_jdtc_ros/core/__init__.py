# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tracker's mathematics: no ROS, no files, numpy and scipy only.

The data's path, with the room or module of each step::

    reports (radar, stamp, Detections)         types
      |  what looks wrong                      watch
      |  cut turns into slices, coverage       turns, antenna, horizon, sectors, turn_history
      |  poses of radars that move             posed_reports, poses
      |  group by stamp, gaps, resets          scans
    Scan                                       pipeline: turns -> posed_reports -> scans -> engine
      |  late reports: scans stepped again     late_reports, renumbering
      |  predict, update with every radar      an engine: smc (particles), gaussian
      |    motion, radars, amplitudes, births    models
      |    gating                              pair_search
      |    association probabilities           association
      |    identities and heights              attributes
      |------------- extract ---------------> Estimates (filtered), of the tracks that confirmation
      |                                        reports by a reporting_rule, numbered by
      |                                        track_numbers, with those of known_aircraft, and
      |                                        brought to one stamp by reporting
      |  backward over the lag window          the engine
      |------------- extract ---------------> Estimates (smoothed)

What engines are built from knows no particles, only rows, each of one origin::

    fixed_lag              the window, stamps held back, track numbers and states, snapshots
      forward              a filter's rows that later scans continue, and its births
        touch              the origins that an antenna may have passed
      backward             the way from each set of the window to its sources
    window                 what is kept of one scan: rows, sources, link
    window_snapshot        its storage, and clutter_snapshot that of what is learned of clutter;
                           snapshot has checked arrays and numbers
    origins                the numbers of rows' origins

`site`, `sited_plots` and `ellipsoid` place the plots of radars that stand on the round earth in the
plane that targets are tracked in.

`biases` are what a radar's measurements are off by: they are removed before all of this.
`registration` finds them from targets that several radars see, and `tuning` finds the other
numbers of a configuration, both in recordings. `plot_turns` counts an antenna's turns for their
mean, for `tuning` and for the bridge that reads ASTERIX. `innovations` tells live that the noise is
wrong.

`engine` is the interface of all engines, and `engines` creates one by its name. `configuration`
turns parameters into models and settings. `region` is the part of an area that a tracker is for,
and `handover` joins the estimates of several; `joint_picture` does so as they come, with
`gathering` to bring together those of one stamp, `joinable` to refuse what cannot be joined,
`track_series` to tell apart tracks of a tracker that began to number them again, and
`joint_numbers` for the numbers that smoothed estimates get. `simulation` makes scans with known
truth, and `evaluation` compares estimates with it.

Packages import in one direction only::

    pipeline -> engines -> configuration -> smc, gaussian -> association, models, pair_search
    models, forward -> attributes -> sited_plots -> site
    smc, gaussian -> fixed_lag -> forward -> touch, window_snapshot -> window
    fixed_lag -> confirmation, track_numbers -> known_aircraft -> models
    confirmation, configuration -> reporting_rule -> models
    smc, gaussian -> backward -> window
    registration -> tuning -> configuration
    evaluation, simulation -> models          everything -> types, state_space, arrays, quoting
    association, pair_search -> backend, which inner loops are in use -> compiled, by numba

By default both engines are labelled multi-Bernoulli filters with soft association, as JPDA's: every
origin is at most one target, and no hard assignment is made. Particles, the default, can also be
the PHD filter of the paper, with ``corrector: poisson``.

The method is based on Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's. Where the code
departs from the paper, the docstring says so under "Deviation".
"""
