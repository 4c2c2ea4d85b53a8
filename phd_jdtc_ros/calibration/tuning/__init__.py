"""Estimates a radar's rotation, noise, detection probability and clutter from a recording.

    plots -> rotation -> start, then in turn: tracks <-> noise -> rates -> findings -> proposal

`plots` holds one radar's detections as columns. `rotation` estimates the antenna's rotation.
`tracking` links plots to tracks and estimates the noise. `start` finds an initial guess of both.
`rates` estimates the detection probability, the clutter rate and the coverage, and `resting`
whether what stays in its place is clutter. `findings` alternates between these and holds the
results, which `proposal` turns into parameters.
"""
