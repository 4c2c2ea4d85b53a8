"""A Kalman filter over one radar's plots: their tracks, and the noise that explains these best.

`tracks` links plots to tracks, given the noise; `noise` estimates the noise, given tracks, by the
likelihood of their innovations. Their loops over plots, `linking` and `likelihood`, are compiled,
and loaded when the first recording is evaluated.
"""
