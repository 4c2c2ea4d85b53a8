"""The tracker's cost, measured against baselines: ``make bench``.

Not part of the installed package. The data's path::

    scenes      scenes with any number of targets, and the tracker's configuration for them
    traffic     the same for aircraft and a radar that turns
    recursion   an engine's step, divided into its parts       -> parts, stored sets
    forms       the paper's dense smoother and a k-d tree's    -> baselines
    timing      interleaved rounds, medians, memory
      |
    smoothing, growth, steps, step_growth, messages, peers, live, turning,
    asterix_rates (asterix_latency)
      |
    goals -> report (tables), plots, out/bench/summary.json

Everything runs in one process on one thread, except that the live measurements start
nodes as further processes. Times are CPU times, except those over DDS.
"""
