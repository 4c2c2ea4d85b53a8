"""Estimates a radar's rotation, noise, detection probability and clutter from a recording.

    plots -> timing -> guess, then in turn: tracks <-> noise -> rates -> findings -> proposal

`plots` holds one radar's detections as columns, and estimates the antenna's rotation. `tracks`
finds an initial guess of noise and tracks, and links plots to tracks by a Kalman filter, given the
noise; `noise` estimates the noise, given tracks, by the likelihood of their innovations. Their
loops over plots are compiled, in `linking`, and loaded when the first recording is evaluated.
`rates` estimates the detection probability, the clutter rate and the coverage, finds copies of
plots, and whether what stays in its place is clutter. `findings` alternates between these and holds
the results. `proposal` turns them into parameters, `unspecified` into those of a tracker without a
configuration, and `remarks` into sentences for the user.
"""
