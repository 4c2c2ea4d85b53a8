"""The tracker's mathematics: the path of a scan, without ROS, files or parameter names.

The path of the data, with the package of each step::

    reports (radar, stamp, Detections)         types
      |  check for anomalies                   intake.input_checks, intake.clocks
      |  cut revolutions into slices          intake.revolutions, antenna, sectors
      |  attach poses of moving radars         intake.posed_reports, poses, transforms
      |  group by stamp, gaps, resets          intake.scans
    Scan                                       pipeline: revolutions -> posed_reports -> scans
      |  reprocess out-of-sequence reports     intake.out_of_sequence, revolution_history
      |  predict                               window.forward_filter: gaussian, targets
      |  update, report by report              window.update
      |  reduce                                gaussian.reduction
      |  pair with self-reports                reports, by window.update
      |------------- extract ---------------> Estimates (filtered): tracks with confirmation,
      |                                        numbers and a common stamp
      |  backward over the lag window          window.fixed_lag, gaussian.smoothing
      |------------- extract ---------------> Estimates (smoothed)
      |  draw possible paths of the tracks     gaussian.paths
      |------------- compare ---------------> Conflicts, with alarms: conflicts

The weight of an association is p_D times the likelihood over the density of false detections, times
one factor for each further thing that is known. The update with one report is (`window.update`)::

    expected  = factors.expect(report)           noise, p_D, clutter of this report: a View
    prior     = of(rows, expected)               expected measurements, p_D of each hypothesis
    view      = factors.given(expected, prior)   clutter that the targets cause; limit, bursts
    pairs     = factors.gate(prior, view)        at the height of each target, by its address
    evidence  = factors.evidence(pairs)          identities and heights
    others    = clutter and undetected targets   models.competing_sources, detection_birth
    posterior = prior.posterior(pairs, evidence, others)   association, gaussian.measurement
    rows      = posterior and the newborn targets
    factors   = factors.after(look)              each factor learns from the association

`sensors` is physics: place, measurement, noise, coverage, and the `View` of a report. `factors` has
one file for each assumption about the world, with one interface; `models` puts targets, sensors and
factors together. `phd` is the paper's room: its filter and smoother, of particles and in closed
form, with a window of its own. `engine` is the interface of both. `snapshot` stores values as named
arrays and checks them against bounds that are declared with their fields. `compilation` compiles
functions of arrays, and `bisection` searches ascending arrays in compiled functions.

The packages import downwards only; contracts in ``pyproject.toml`` enforce this::

    pipeline, conflicts
    window, phd
    gaussian
    intake
    engine
    tracks
    models
    factors
    reports
    sensors
    association, targets
    types
    bisection, snapshot, state_space
    compilation
    arrays

Around the core, `configuration` turns parameters into models, `simulation` makes scans with known
truth, `evaluation` compares estimates with the truth, `calibration` estimates parameters and
systematic errors from recordings, and `handover` joins the estimates of several trackers.

The tracker is a labelled multi-Bernoulli filter with marginal association, as in JIPDA: every label
is at most one target, and no hard assignment is made.

The method is based on Y. Qin, "Joint Target Detection, Tracking and Classification with
Forward-Backward PHD Smoothing". Sections cited in the docstrings are the paper's. A docstring
describes departures from the paper under "Deviation".
"""
