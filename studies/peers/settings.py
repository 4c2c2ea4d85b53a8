"""The peers' tuned settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True)
class PhdSettings:
    """Settings of the GM-PHD."""

    gate: float  # Gate in standard deviations of the innovation
    prune: float  # Least weight of a component
    merge: float  # Squared Mahalanobis distance below which components merge
    most: int  # Largest number of components
    extract: float  # Weight above which a component is reported as a target


@dataclass(frozen=True)
class TrackSettings:
    """Settings of the track-based peers.

    A look is one radar's report of one scan.
    """

    gate: float  # In standard deviations of the innovation
    points: int  # Number of detections that confirm a tentative track
    # `tentative_looks`, `looks`: number of consecutive missed looks after which a tentative and a
    # confirmed track end.
    tentative_looks: int
    looks: int
    # A detection starts a track if it is within this many standard deviations of a birth place;
    # None for anywhere.
    birth_gate: float | None
    min_speed: float = 0.0  # Slower targets are not reported, metres per second


Settings: TypeAlias = "PhdSettings | TrackSettings"
GM_PHD = PhdSettings(gate=5.0, prune=1e-5, merge=4.0, most=100, extract=0.5)
AT_BIRTH_PLACES = TrackSettings(gate=3.5, points=4, tentative_looks=2, looks=5, birth_gate=4.0)
# Settings for unknown birth places: tracks are confirmed later, and a run takes several times as
# long.
ANYWHERE = TrackSettings(gate=3.0, points=6, tentative_looks=2, looks=3, birth_gate=None)
# Settings for detections above an amplitude threshold that leaves so little clutter that two
# detections suffice to confirm a track.
LOUD_THRESHOLD = 5.0
LOUD = TrackSettings(gate=4.0, points=2, tentative_looks=2, looks=4, birth_gate=4.0)
