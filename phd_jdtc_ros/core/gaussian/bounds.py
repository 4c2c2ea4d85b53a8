"""Limits of the reduction; a configuration has them before an engine loads compiled code."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bounds:
    """Limits of the reduction."""

    hypotheses: int  # Largest number per target before hypotheses are split by motion mode
    # Hypotheses with less than this share of their target's existence probability are dropped.
    least_share: float
    # Twice the Kullback-Leibler divergence, mode by mode, within which hypotheses are merged: the
    # square Mahalanobis distance of their means if their covariances are equal.
    merge_distance: float
    least_existence: float  # Targets with a smaller existence probability are dropped
    most: int  # Largest number of hypotheses of all targets together
    # Motion modes with at least this share of their hypothesis become hypotheses of their own; with
    # 1 none does, and every prediction mixes the modes.
    least_mode: float
