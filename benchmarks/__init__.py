"""The tracker's cost, measured against baselines: ``make bench``.

Not part of the installed package. The data's path::

    scenes      scenes with any number of targets, and the tracker's configuration for them
    traffic     the same for aircraft and a radar that turns
    timing      interleaved rounds, medians, memory
      |
    engine      a step, divided into its parts, its growth, and other trackers
    transport   messages, DDS and ASTERIX, end to end
      |
    results     goals -> tables, pictures, out/bench/summary.json

Everything runs in one process on one thread, except that the live measurements start
nodes as further processes. Times are CPU times, except those over DDS.
"""
