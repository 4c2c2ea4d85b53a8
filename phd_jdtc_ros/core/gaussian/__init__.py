"""The algebra of the engine: a mixture of Gaussian hypotheses for each target, and its smoother.

The path of one scan, with the module of each step::

    stored mixture t                         mixture
      |  predict: survive, spawn, be born    prediction, dynamics
      |    mix motion modes, keep gains        algebra.blocks, algebra.curvature
      |  update, report by report            window.update: the order; update: its steps
      |    gate                                gating, amplitude
      |    iterated Kalman update              iterated_update, kalman
      |    select the likely pairs             likely_pairs
      |    associate                           pair_association, core.association
      |    keep the probable hypotheses        pruning
      |    give birth at detections            newborn
      |  merge similar hypotheses            reduction
    stored mixture t+1                       (window.forward_filter: the steps in order)
      |  link to mixture t                   lineages: the updates of each target
      |  backward over the lag window        backward_step
    smoothed hypotheses
      |  extract targets at a stamp          smoother, extraction
    Estimates                                window.fixed_lag

Expected measurements, gates and innovations are the sensor's (`Sensor.of_gaussians`), those of
range and azimuth compiled. `entries` are the mixtures of the scans of a window and their links;
the filter and the smoother over scans are in `core.window`. `algebra` has the operations on
Gaussians, `measurement` the steps of the update with one radar's detections, and `smoothing` those
of the smoother.
"""
