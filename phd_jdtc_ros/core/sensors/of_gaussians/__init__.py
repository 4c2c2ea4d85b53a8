"""The measurements that sensors make of Gaussians: array operations, and compiled ones.

`linearised` has the size of the gate and what all sensors share, `polar`, `polar_gate`, `planar`
and `spatial` are compiled, and `angles` wraps azimuths in compiled code.
"""
