# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How fast the tracker is, measured beside the forms it replaces: ``make bench``.

Not part of the installed package. The way of a figure::

    scenes      targets of any number, and the tracker's configuration for them
    recursion   the engine's step laid open, part by part      -> parts, stored sets
    forms       the paper's dense smoother and a k-d tree's    -> baselines
    timing      interleaved rounds, medians, memory
      |
    smoothing, growth, steps, messages, peers, live            one measurement each
      |
    goals -> report (tables), plots, out/bench/summary.json

Everything runs in one process, on one thread; only the live measurement starts a second process,
the tracker node. Times are of the CPU but for those that go over DDS.
"""
