"""The two correctors: rules by which one radar's detections change the intensity.

`BERNOULLI`, the default, is the corrector of a labelled multi-Bernoulli filter. The particles of
one label represent at most one target, which causes at most one detection. A missed detection
changes its existence probability by Bayes' rule. `POISSON` is the corrector of the PHD filter
(Sec. IV-C, Step 2). Targets are a Poisson process: the mass at one place may cause any number of
detections, and a missed detection scales it down by 1 - p_D.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, factorize, sum_by
from ..association.bernoulli import bernoulli
from ..association.claims import Claims
from .particle_set import ParticleSet, scale_rows


class Corrected(NamedTuple):
    """The intensity after one radar's detections."""

    particles: ParticleSet
    claimed: FloatArray  # Probability that a target caused each detection, (M,)
    pair: FloatArray  # Weight of each pair's particle under its detection, (P,)


class Corrector(NamedTuple):
    """A correction rule, and whether it gives one label to each target."""

    # Returns the intensity corrected with the association likelihoods of all pairs.
    correct: Callable[[ParticleSet, Claims], Corrected]
    labelled: bool  # Whether the particles of one label represent at most one target


def _poisson(particles: ParticleSet, claims: Claims) -> Corrected:
    """Correct as the PHD filter does, with a component for every detection.

    Earlier components are multiplied by 1 - p_D, and M new components are added. Sec. IV-C, Step 2.
    """
    size = len(claims.other)
    claimed = sum_by(claims.column, claims.mass, size)
    total = claims.other + claimed
    total = np.where(total > 0.0, total, 1.0)
    pair = claims.mass / total.take(claims.column)
    assigned = sparse.csr_array((pair, (claims.row, claims.column)), shape=(len(particles), size))
    missed = 1.0 - claims.detection_probability
    corrected = replace(
        particles,
        poisson=particles.poisson * missed,
        components=sparse.hstack(
            [scale_rows(particles.components, missed), assigned], format="csr"
        ),
        label=np.concatenate([particles.label, np.full(size, -1)]),
    )
    return Corrected(corrected, claimed / total, pair)


def _bernoulli(particles: ParticleSet, claims: Claims) -> Corrected:
    """Correct each label as at most one target, with a component for every label.

    Deviation from Sec. IV-C, Step 2; see `association.bernoulli`. The posterior is a labelled
    multi-Bernoulli density.
    """
    distinct, target = factorize(particles.row_label)
    shares = bernoulli(target, len(distinct), particles.weight, claims)
    weight = shares.prior * (1.0 - claims.detection_probability) * shares.missed.take(target)
    pair = claims.mass * shares.pair
    weight += sum_by(claims.row, pair, len(particles))
    corrected = replace(
        particles,
        poisson=np.zeros(len(particles)),
        components=sparse.csr_array(
            (weight, target, np.arange(len(particles) + 1)), shape=(len(particles), len(distinct))
        ),
        label=distinct,
    )
    return Corrected(corrected, shares.claimed, pair)


BERNOULLI = Corrector(_bernoulli, labelled=True)
POISSON = Corrector(_poisson, labelled=False)
CORRECTORS = {"bernoulli": BERNOULLI, "poisson": POISSON}
