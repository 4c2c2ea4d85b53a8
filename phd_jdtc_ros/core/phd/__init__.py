"""The paper's PHD filter and smoother with a general mode, to be read beside the paper.

It has the paper's steps, and each docstring names its deviations. A target has a state, a class
and a motion mode; it is born or spawned, is detected with an amplitude, and has no identity.

The path of one scan, with the paper's step and the module of each::

    stored intensity t
      |  predict: survive, spawn, be born     Step 1   prediction, gaussian_mixture
      |  correct, radar by radar              Step 2   correction, gaussian_mixture
      |  resample, or merge and prune         Step 3   resampling, gaussian_mixture
    stored intensity t+1
      |  link to the intensity t              Step 4   kernel, gaussian_filter
      |  backward over the lag window         Step 4   smoothing, gaussian_filter
    smoothed intensities
      |  extract targets                      Step 6   extraction
    Estimates                                          engine

`engine` steps a recursion over the scans and keeps the window. The two recursions are
`particle_filter` (Sec. IV-C with the errors corrected; the death term and the extraction also as
printed) and `gaussian_filter`, the closed form that the paper's last sentence leaves for further
study. Step 5, resampling after smoothing, is part of the printed extraction only: smoothed sets are
extracted and not propagated.

The models of Sec. V are outside: f, Q, h and P_s in `targets.motion` and `targets.modes`, gamma and
beta in `targets.birth`, p_D and g_c in `targets.amplitude_density`, the measurement and L_z in
`sensors`, and kappa in `sensors.view`. Deviation: the paper's interval is constant. Here rates and
probabilities are given for a nominal interval, and converted to the true one, `dt`.

Both recursions have one intensity over (x, o), with the general mode o = (class, motion):
`particles` or a `gaussian_mixture`. After a correction it is a Poisson part, which no detection
explains, and one Bernoulli component for every detection, of at most one target. The corrected
death term and the extraction use this split.
"""
