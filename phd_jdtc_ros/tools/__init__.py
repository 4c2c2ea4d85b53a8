"""The executables that are not nodes; `command` has what they share.

::

    track_bag                       a bag's detections to estimates, as the live tracker does
    simulate, monte_carlo           a scenario to a bag; studies of many
    report                          a page, pictures and scores of a bag with estimates
    tune, register                  parameters, and biases of radars, from a recording
    asterix, report_bridge          recordings of ASTERIX, AIS and ADS-B to bags and back
    hand_over                       estimates of several trackers to one picture

`recorded_plots` and `recorded_clouds` read and make the bags, and `launching` is for launch files.
"""
