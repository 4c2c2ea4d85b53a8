# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Association probabilities from all matchings, one after the other."""

import itertools

import numpy as np


def enumerated(odds, clutter):
    """Return (T, M) and (T,) exact marginals of dense odds, event by event."""
    edge, none, total = np.zeros_like(odds), np.zeros(len(odds)), 0.0
    for event in itertools.product(*[[-1, *np.flatnonzero(row)] for row in odds]):
        used = [z for z in event if z >= 0]
        if len(set(used)) < len(used):
            continue
        weight = np.prod([odds[t, z] / clutter[z] for t, z in enumerate(event) if z >= 0])
        total += weight
        for t, z in enumerate(event):
            if z >= 0:
                edge[t, z] += weight
            else:
                none[t] += weight
    return edge / total, none / total
