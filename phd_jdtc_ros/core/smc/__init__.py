# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The particle engine: a sequential Monte Carlo filter with a fixed-lag backward smoother.

A scan's way, with the module of each step::

    stored set t                             particle_set
      |  predict: survive, spawn, be born    prediction
      |  update, radar by radar              update
      |    correct every origin              correction
      |  resample within (class, origin)     resampling, budget
    stored set t+1                           (filter: the four steps in order)
      |  kernel from set t, cached           backward_kernel, kernel_thinning
      |  backward over the lag window        smoother
    smoothed sets
      |  read targets off                    extraction
    Estimates                                engine

`snapshot` turns all that the engine holds into arrays and back.
"""
