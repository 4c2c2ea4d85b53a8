"""Determines which biases are observable, and which only relative to the reference radar.

A time offset common to all radars is never observable, because it only shifts time. A common
rotation or gain is observable if the radars are far enough apart, because they rotate about
different centres. Nothing is observable without common targets. A bias counts as observable if its
standard deviation is well below the noise of one plot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray

from .common import Sequences, Target
from .filtering import KINDS
from .tracked_radars import RegistrationError, TrackedRadar

# Targets are on a line if their extent across it is below this share of the extent along it.
LINE = 0.02
# A recording with fewer scans is short.
SHORT = 20.0
# A bias is not observable if its standard deviation exceeds this share of one plot's.
OBSERVABLE_SHARE = 0.5


@dataclass(frozen=True)
class Observability:
    """The biases that can be estimated."""

    free: BoolArray  # True where each of the P biases can be estimated, (P,)
    # Covariance of the biases in the equations' units, (P, P); zero for those that are not free.
    covariance: FloatArray
    common: tuple[str, ...]  # Kinds of biases for which the reference radar is assumed to have none
    hidden: tuple[int, ...]  # Indices of the unobservable biases of other radars


def analyse(information: FloatArray, one_plot: FloatArray, reference: int) -> Observability:
    """Determine which biases can be estimated, given their information matrix, shape (P, P).

    `one_plot`, shape (P,), is the standard deviation of one plot as a bias of each kind, in the
    equations' units; `reference` is the index of the reference radar.
    """
    free = np.ones(len(one_plot), dtype=bool)
    kinds = len(KINDS)
    time_offset = KINDS.index("time_offset_s")
    free[kinds * reference + time_offset] = False
    common, hidden = [KINDS[time_offset]], []
    while free.any():
        rows = np.flatnonzero(free)
        scaled = information[np.ix_(rows, rows)] * np.outer(one_plot[rows], one_plot[rows])
        value, vector = np.linalg.eigh(scaled)
        value = np.maximum(value, 1e-12)
        std = np.sqrt(((vector**2) / value).sum(axis=1))
        if std.max() < OBSERVABLE_SHARE:
            break
        # The least observable combination of biases decides.
        share = vector[:, 0] ** 2
        by_kind = np.array([share[rows % kinds == kind].sum() for kind in range(kinds)])
        kind = int(np.argmax(by_kind))
        own = kinds * reference + kind
        if free[own] and share[rows == own].max() > 0.02:
            free[own] = False
            common.append(KINDS[kind])
        else:
            worst = int(rows[np.argmax(np.where(rows // kinds != reference, share, -1.0))])
            if worst // kinds == reference:
                worst = int(rows[np.argmax(share)])
            free[worst] = False
            hidden.append(worst)
    covariance = np.zeros_like(information)
    rows = np.flatnonzero(free)
    if len(rows):
        covariance[np.ix_(rows, rows)] = np.linalg.inv(information[np.ix_(rows, rows)])
    return Observability(free, covariance, tuple(common), tuple(hidden))


def require_common(radars: Sequence[TrackedRadar], targets: Sequence[Target]) -> None:
    """Raise `RegistrationError` if a radar has no target in common with the others."""
    groups = [{index} for index in range(len(radars))]
    for target in targets:
        own = {radar for radar, _ in target}
        linked = [group for group in groups if group & own]
        groups = [own.union(*linked), *(group for group in groups if group not in linked)]
    largest = max(groups, key=lambda group: (len(group), -min(group)))
    if len(largest) == len(radars):
        return
    others = set(range(len(radars))) - (largest if len(largest) > 1 else set())
    alone = [radars[index] for index in sorted(others)]
    end = min(float(each.time_s[-1]) for each in radars)
    seconds = max(end - max(float(each.time_s[0]) for each in radars), 0.0)
    counts = "; ".join(f"{each.name} has {len(each.tracks)} tracks" for each in alone)
    raise RegistrationError(
        f"no common targets: {counts}, none near a track of another radar, in the {seconds:.0f} s "
        "covered by all radars; check position, yaw_deg (to 1 degree) and clocks (to 1 s), or "
        "record longer"
    )


def require_observable(
    radars: Sequence[TrackedRadar], free: BoolArray, reference: int, plots: Sequences
) -> None:
    """Raise `RegistrationError` if no bias of a radar but the reference is observable."""
    nothing = [
        each.name
        for index, each in enumerate(radars)
        if index != reference and not free.reshape(-1, len(KINDS))[index].any()
    ]
    if nothing:
        raise RegistrationError(
            f"{', '.join(nothing)}: no bias is observable: {hidden_reason(radars, plots)}"
        )


def hidden_reason(radars: Sequence[TrackedRadar], plots: Sequences) -> str:
    """Return the reason why biases are unobservable."""
    count, targets = int(np.count_nonzero(plots.valid)), plots.valid.shape[1]
    seen = f"{targets} common tracks with {count} plots"
    place = plots.position[plots.valid]
    extent = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    if extent[1] < LINE * extent[0]:
        return f"{seen}, all on one line"
    begin, end = plots.time_s[plots.valid].min(), plots.time_s[plots.valid].max()
    looks = (end - begin) / max(each.look_s for each in radars)
    if looks < SHORT:
        return f"{seen}, too short: {looks:.0f} looks in {end - begin:.0f} s"
    return f"{seen}, too few, or all in one place"
