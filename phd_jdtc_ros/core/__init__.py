"""The tracker's mathematics, only what a scan passes: no ROS, no files, no parameters' names.

The data's path, with the room of each step::

    reports (radar, stamp, Detections)         types
      |  what looks wrong                      intake.input_checks
      |  cut turns into slices, coverage       intake.turns, antenna, horizon, sectors
      |  poses of radars that move             intake.posed_reports, poses
      |  group by stamp, gaps, resets          intake.scans
    Scan                                       pipeline: turns -> posed_reports -> scans -> engine
      |  late reports: scans stepped again     intake.out_of_sequence, turn_history
      |  predict, update with every radar      an engine: gaussian, smc (particles)
      |    motions, births, spawning             targets
      |    measurements, visibility              sensors
      |    false detections                      clutter
      |    which detections are near             pair_search
      |    association probabilities             association
      |    identities and heights                attributes
      |------------- extract ---------------> Estimates (filtered): tracks, with their confirmation,
      |                                        their numbers and one stamp
      |  backward over the lag window          window, and the engine
      |------------- extract ---------------> Estimates (smoothed)

`models` puts targets, sensors and clutter together into the model that both engines share.
`window` knows neither particles nor Gaussians, only rows, each with the label of its target.
`engine` is the interface of both engines, and `snapshot` the arrays and numbers that they are
stored as. `compilation` compiles functions over arrays; `backend` says which inner loops are in
use where there are two kinds, and `numba_loops` compiles one of them.

The rooms import downwards only, see the contracts in ``pyproject.toml``::

    pipeline
    gaussian, smc
    window
    intake
    engine
    tracks
    models
    attributes
    sensors
    clutter
    association, pair_search, targets
    backend, snapshot, types
    compilation, numba_loops, state_space
    arrays

What is around the core: `configuration` turns parameters into models, `simulation` makes scans
with known truth, `evaluation` compares estimates with it, `calibration` finds parameters and
systematic errors in recordings, `handover` joins the estimates of several trackers.

By default both engines are labelled multi-Bernoulli filters with soft association, as JPDA's:
every label is at most one target, and no hard assignment is made. Particles can also be the PHD
filter of the paper, with ``corrector: poisson``.

The method is based on Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's. Where the code
departs from the paper, the docstring says so under "Deviation".
"""
