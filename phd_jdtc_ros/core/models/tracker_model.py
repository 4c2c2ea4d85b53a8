# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""All models that the recursion uses, in one value."""

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

# Origins are numbered scan by scan; the second half of a scan's numbers is for births at its
# detections.
ORIGINS_PER_SCAN = 1 << 24


@dataclass(frozen=True)
class TrackerModel:
    """All models of targets and radars that the recursion uses.

    Rates and probabilities are given for the mode space's nominal interval and converted to the
    true one.

    Parameters
    ----------
    modes : ModeSpace
        Classes, their motion modes, and the transitions between these.
    births : tuple of BirthTerm
        Births at known positions.
    detection_births : DetectionBirthModel
        Births at detections.
    spawn : SpawnModel
    amplitudes : AmplitudeModel
    radars : tuple of RadarModel
        In the order of updates.
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
        """Whether an origin is at most one target, and so can serve as its label."""
        return self.corrector is bernoulli
