# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is assumed about targets, motion and radars; no engine and no algorithm.

::

    state_space            which axis of a state is what
    motion                 x' = mean(x, dt) + noise: constant velocity, coordinated turn
    modes                  the flat index over (class, motion) and its Markov chain
    birth, sobol           targets that appear at known places
    detection_birth        targets that appear anywhere, founded by detections
    spawn                  targets that split off others
    radar                  geometry, measurement noise, range, clutter
    amplitude_density      Rayleigh targets and clutter, SNR bands
    amplitude_model        what amplitudes say of the class: band, memory, nothing
    tracker_model          all of these in one value, for an engine
"""
