# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the recursion assumes about targets and radars, and how many particles it spends."""

from __future__ import annotations

from dataclasses import dataclass

from . import motion
from .birth import BirthTerm
from .correction import Corrector, bernoulli
from .detection_birth import DetectionBirthModel
from .modes import ModeSpace
from .radar import RadarModel
from .signature import AmplitudeModel
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


@dataclass(frozen=True)
class ParticleBudget:
    """How many particles stand for what.

    Parameters
    ----------
    per_target : int
        Copies a unit of mass is resampled to.
    least : int
        Copies that a (class, origin) group gets at the least.
    per_birth_term : int
        A power of two.
    most : int
        Copies in all that are kept of a scan.
    """

    per_target: int
    least: int
    per_birth_term: int
    most: int
