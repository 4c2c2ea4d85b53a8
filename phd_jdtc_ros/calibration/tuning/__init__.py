"""What a recording says of the radar that made it: its turns, noise, detections and clutter.

    plots -> rotation -> start, then in turn: tracks <-> noise -> rates -> findings

`plots` are one radar's detections as columns. `rotation` finds how the antenna turns. `tracks`
links plots to tracks, given the noise; `noise` finds the noise, given tracks, by the likelihood of
their innovations; `start` finds a first guess for the two. `rates` counts what was detected, missed
and false, and `field` says where plots were seen. `findings` holds the results.
"""
