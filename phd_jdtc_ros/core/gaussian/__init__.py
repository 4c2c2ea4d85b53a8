# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Gaussian tracks: the iterated extended Kalman filter and the Rauch-Tung-Striebel smoother.

::

    Gaussian (mean, covariance)
      |  predict, update                     ekf
    Filtered, scan after scan
      |  backward                            rts
    smoothed Gaussian

The study's model-matched reference uses these.
"""
