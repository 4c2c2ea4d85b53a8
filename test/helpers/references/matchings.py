"""Association probabilities from all matchings, one after the other."""

import itertools
import math

import numpy as np


def enumerated(odds, clutter):
    """Return (T, M) and (T,) exact marginals of dense odds, event by event.

    Entries may be fractions, which neither overflow nor round.
    """
    edge, none, total = np.zeros_like(odds), np.zeros(len(odds), dtype=odds.dtype), 0
    for event in itertools.product(*[[-1, *np.flatnonzero(row)] for row in odds]):
        used = [z for z in event if z >= 0]
        if len(set(used)) < len(used):
            continue
        weight = math.prod(odds[t, z] / clutter[z] for t, z in enumerate(event) if z >= 0)
        total += weight
        for t, z in enumerate(event):
            if z >= 0:
                edge[t, z] += weight
            else:
                none[t] += weight
    return edge / total, none / total


def posterior(target, weight, missed, detected):
    """Return (N,) and (N, M) posterior masses of rows that were missed, and with each detection.

    `target` has the target of each row, and `weight` its weight before; `missed`, (N,), and
    `detected`, (N, M), are what its weight is multiplied to by 1 - p_D, and by p_D times the
    likelihood over the intensity of the detection's other sources. Every target does not exist, is
    missed or is the source of one detection; no two are of the same one.
    """
    targets, count = int(target.max()) + 1, detected.shape[1]
    absent = 1.0 - np.bincount(target, weight)
    ways = np.column_stack([detected, missed, np.zeros(len(target))])
    mass = np.array([ways[target == one].sum(axis=0) for one in range(targets)])
    mass[:, -1] = absent
    total, chosen = 0.0, np.zeros_like(mass)
    for event in itertools.product(range(count + 2), repeat=targets):
        used = [way for way in event if way < count]
        if len(set(used)) < len(used):
            continue
        probability = np.prod(mass[range(targets), event])
        total += probability
        chosen[range(targets), event] += probability
    factor = np.divide(chosen, mass * total, out=np.zeros_like(mass), where=mass > 0.0)
    every = ways * factor[target]
    return every[:, count], every[:, :count]
