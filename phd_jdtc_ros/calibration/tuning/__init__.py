"""Estimates a radar's rotation, noise, detection probability and clutter from a recording.

    plots -> rotation -> start, then in turn: tracks <-> noise -> rates -> findings -> proposal

`plots` holds one radar's detections as columns. `rotation` estimates the antenna's rotation.
`tracks` links plots to tracks by a Kalman filter, given the noise, and `noise` estimates the noise,
given tracks, by the likelihood of their innovations. Their loops over plots are compiled, in
`linking` and `likelihood`, and loaded when the first recording is evaluated. `start` finds an
initial guess of noise and tracks. `rates` estimates the detection probability, the clutter rate and
the coverage, and whether what stays in its place is clutter. `findings` alternates between these
and holds the results, which `proposal` turns into parameters.
"""
