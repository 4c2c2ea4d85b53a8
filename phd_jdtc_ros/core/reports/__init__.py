"""The layer of self-reports beside the engine: owners of sources, silence, and doubt.

Radar tracks are not changed by reports. Each pair of a source and a track that may be its own has a
second filter, of plots and reports, with the antenna's place in the ship's frame as a state, and
the accumulated likelihood ratio of "the source reports this target, and rightly" against "it does
not". The estimate of a track is the mixture of its own and those of its pairs.

::

    SelfReports                          types
      |  split by address and path       sources: ghosts, which are filters of the reports alone
      |  sources, new pairs              pairs: which begin and end
      |  reports                         pair_filter: a state with the antenna's offset
    plots of a look                      looks: the association probabilities of the engine
      |  owners                          owners: marginals of sources and tracks
      |  silence, dark, doubt            silence, judgement
    Estimates                            beside: the layer as one value; mixture, smoothing
"""
