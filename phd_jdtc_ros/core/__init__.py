"""The tracker's mathematics: the path of a scan, without ROS, files or parameter names.

The path of the data, with the package of each step::

    reports (radar, stamp, Detections)         types
      |  check for anomalies                   intake.input_checks
      |  cut turns into slices, coverage       intake.turns, antenna, report_timing, sectors
      |  attach poses of moving radars         intake.posed_reports, poses, transforms
      |  group by stamp, gaps, resets          intake.scans
    Scan                                       pipeline: turns -> posed_reports -> scans -> engine
      |  reprocess out-of-sequence reports     intake.out_of_sequence, turn_history
      |  predict                               an engine: gaussian, smc (particles)
      |  update, report by report              window.update, with the engine's steps
      |    motions, births, spawning             targets
      |    measurements, coverage, gates         sensors: Report and Sensor
      |    false detections                      clutter
      |    learned detection and noise           learned
      |    near pairs                            pair_search
      |    association probabilities             association
      |    identities and heights                attributes
      |------------- extract ---------------> Estimates (filtered): tracks with confirmation,
      |                                        numbers and a common stamp
      |  backward over the lag window          window, and the engine
      |------------- extract ---------------> Estimates (smoothed)

`models` combines targets, sensors and clutter into the model that both engines share.
`window` depends on neither particles nor Gaussians, only on rows with the label of their target.
`engine` is the interface of both engines. `snapshot` stores values as named arrays and checks them
against bounds that are declared with their fields. `compilation` compiles functions of arrays, and
`bisection` searches ascending arrays in compiled functions.

The packages import downwards only; contracts in ``pyproject.toml`` enforce this::

    pipeline
    gaussian, smc
    window
    intake
    engine
    tracks
    models
    attributes
    sensors
    clutter, learned
    association, pair_search, targets
    types
    bisection, snapshot, state_space
    compilation
    arrays

Around the core, `configuration` turns parameters into models, `simulation` makes scans with known
truth, `evaluation` compares estimates with the truth, `calibration` estimates parameters and
systematic errors from recordings, and `handover` joins the estimates of several trackers.

By default both engines are labelled multi-Bernoulli filters with soft association as in JPDA:
every label is at most one target, and no hard assignment is made. With ``engine: phd`` the particle
engine is the PHD filter of the paper.

The method is based on Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's. A docstring
describes departures from the paper under "Deviation".
"""
