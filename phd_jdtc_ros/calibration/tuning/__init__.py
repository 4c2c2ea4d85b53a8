"""Estimates a radar's rotation, noise, detection probability and clutter from a recording.

    plots -> rotation -> start, then in turn: tracks <-> noise -> rates -> findings

`plots` holds one radar's detections as columns. `rotation` estimates the antenna's rotation.
`tracks` links plots to tracks, given the noise; `noise` estimates the noise, given tracks, by the
likelihood of their innovations. Their loops over plots, `linking` and `likelihood`, are compiled
with the steps in `filter_steps`, and loaded when the first recording is evaluated. `start` finds an
initial guess of both. `rates` estimates the detection probability, the clutter rate and the
coverage. `findings` alternates between these and holds the results.
"""
