"""The layer of self-reports beside the engine: owners of sources, silence, and doubt.

Radar tracks are not changed by reports. Each pair of a source and a track that may be its own has a
second filter, of plots and reports, with the antenna's place in the ship's frame as a state, and
the accumulated likelihood ratio of "the source reports this target, and rightly" against "it does
not". The estimate of a track is the mixture of its own and those of its pairs.

::

    SelfReports                          types
      |  sources by address and path     pairs, filters: ghosts, which are of the reports alone
      |  new pairs                       pairs: which begin and end
      |  reports                         pair_filter: a state with the antenna's offset
    plots of a look, corrected           bias
      |  the engine's probabilities      looks
      |  owners                          owners: marginals of sources and tracks
      |  silence, dark, doubt            silence, judgement
    Estimates                            smoothing; beside: the layer as one value
"""
