"""The particle engine: a sequential Monte Carlo filter with a fixed-lag backward smoother.

By default the filtered density is labelled multi-Bernoulli, with the origins as labels. With the
corrector `POISSON` the filter is the PHD filter of the paper. Either way the particles represent
the intensity of the targets.

The path of one scan, with the module of each step::

    stored set t                             particle_set
      |  predict: survive, spawn, be born    prediction; proposals
      |  update, radar by radar              update
      |    correct every origin              correction
      |  resample within (class, origin)     resampling
    stored set t+1                           (filter: the four steps in order)
      |  kernel from set t, cached           backward_kernel, transition_density,
      |                                      spawn_intensity, kernel_thinning
      |  backward over the lag window        smoother
    smoothed sets
      |  extract targets                     extraction
    Estimates                                engine

`filter` and `engine` hold what is of particles; everything else of a fixed-lag filter is in
`core.window`. `snapshot` stores particle sets and kernels as arrays, and restores them.
`proposals` says where particles are drawn, `kernel` has the transition density to later ones. The
steps are those of Sec. IV-C; each module names the step that it implements and its deviations.
"""
