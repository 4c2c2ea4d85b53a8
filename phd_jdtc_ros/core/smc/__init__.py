"""The particle engine: a sequential Monte Carlo filter with a fixed-lag backward smoother.

By default the filtered density is labelled multi-Bernoulli. With the corrector `POISSON` the filter
is the PHD filter of the paper. Either way the particles represent the intensity of the targets.

The path of one scan, with the module of each step::

    stored set t                             particle_set
      |  predict: survive, spawn, be born    prediction; proposals
      |  update, radar by radar              update
      |    correct every label               correction
      |  resample within (class, label)      resampling
    stored set t+1                           (filter: the four steps in order)
      |  kernel from set t, cached           backward_kernel, transition_density,
      |                                      spawn_intensity, kernel_thinning
      |  backward over the lag window        smoother
    smoothed sets
      |  extract targets                     extraction
    Estimates                                engine

`filter` and `engine` hold the parts that are specific to particles; the rest of a fixed-lag filter
is in `core.window`. `snapshot` stores particle sets and kernels as arrays, and restores them.
`proposals` has the proposal densities, `kernel` the transition density between two sets. The
steps follow Sec. IV-C; each module names the step that it implements and its deviations.
"""
