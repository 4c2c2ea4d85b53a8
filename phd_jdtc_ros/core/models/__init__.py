"""Models of targets, motion and radars; no engine and no algorithm.

::

    state_space            the layout of the state vector
    motion                 x' = mean(x, dt) + noise: constant velocity, coordinated turn
    modes                  the flat index over (class, motion) and its Markov chain
    birth, sobol           targets that appear at known places
    detection_birth        targets that appear anywhere, born at detections
    spawn                  targets that appear beside their parents
    radar                  geometry, measurement noise, range, clutter
    clutter_amplitude      laws of the amplitudes of clutter, one of them learned
    clutter_map            where clutter comes from, learned; its cells in clutter_grid
    clutter_neighbourhood  how often the neighbourhood of a place answers
    clutter_raster         the same as a picture of the world
    clutter_memory         what a filter has learned of each radar's clutter
    rest                   whether a target is at rest, as its velocity tells
    overload               the detections of one update that can be afforded
    amplitude_density      Rayleigh targets and clutter, SNR bands
    amplitude_model        use of amplitudes: band, memory, none
    tracker_model          all models in one value, for an engine
"""
