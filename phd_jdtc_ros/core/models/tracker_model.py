# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the recursion assumes about targets and radars, and how many particles it spends."""

from __future__ import annotations

from dataclasses import dataclass

from ..smc.correction import Corrector, bernoulli
from . import motion
from .amplitude_model import AmplitudeModel
from .birth import BirthTerm
from .detection_birth import DetectionBirthModel
from .modes import ModeSpace
from .radar import RadarModel
from .spawn import SpawnModel

# Origins are numbered scan by scan; the second half of a scan's numbers is for those that its
# detections found.
ORIGINS_PER_SCAN = 1 << 24


@dataclass(frozen=True)
class TrackerModel:
    """Everything the recursion assumes about targets and radars.

    Rates and probabilities hold for the mode space's nominal interval and follow the true one.

    Parameters
    ----------
    modes : ModeSpace
        Classes, their motions, and how they change.
    births : tuple of BirthTerm
        Where targets are known to appear.
    detection_births : DetectionBirthModel
        How often they appear anywhere else.
    spawn : SpawnModel
    amplitudes : AmplitudeModel
    radars : tuple of RadarModel
        In the order in which their detections are taken in.
    corrector : Corrector
    state_size : int
    """

    modes: ModeSpace
    births: tuple[BirthTerm, ...]
    detection_births: DetectionBirthModel
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[RadarModel, ...]
    corrector: Corrector = bernoulli
    state_size: int = motion.STATE_SIZE

    @property
    def labelled(self) -> bool:
        """Whether an origin is one target at the most, and so its name."""
        return self.corrector is bernoulli
