"""The algebra of the engine: a mixture of Gaussian hypotheses for each target, and its smoother.

The path of one scan, with the module of each step::

    stored mixture t                         mixture
      |  predict: survive and switch modes   prediction, dynamics
      |    mix motion modes, keep gains        algebra.blocks, algebra.curvature
      |  be born at known places, spawn      new_targets
      |  update, report by report            window.update: the order; update: its steps
      |    gate                                sensors.of_gaussians
      |    lost targets outside their gates    reacquisition
      |    p_D and amplitudes                  measurement.amplitude
      |    select the likely pairs             measurement.likely_pairs, pairs
      |    iterated Kalman update              measurement.iterated_update, algebra.kalman
      |      heights, rates, velocities          measurement.heights, velocity, algebra.range_rate
      |    associate                           measurement.pair_association, core.association
      |    keep the probable hypotheses        measurement.pair_association, missed
      |    give birth at detections            measurement.newborn
      |    show the noise of the sensor        measurement.noise, algebra.heavy_tails
      |  merge similar hypotheses            reduction, within its bounds
    stored mixture t+1                       (window.forward_filter: the steps in order)
      |  link to mixture t                   smoothing.lineages, updates
      |  backward over the lag window        smoothing.backward_step
    smoothed hypotheses
      |  extract targets at a stamp          smoothing.smoother, extraction
    Estimates                                window.fixed_lag
      |  possible paths from now on          paths

Expected measurements, gates and innovations are the sensor's (`Sensor.of_gaussians`), those of
range and azimuth compiled. `entries` are the mixtures of the scans of a window and their links;
the filter and the smoother over scans are in `core.window`.
"""
