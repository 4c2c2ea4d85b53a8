# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is assumed about targets and radars, in one value."""

from __future__ import annotations

from dataclasses import dataclass

from .amplitude_model import AmplitudeModel
from .birth import BirthTerm
from .detection_birth import DetectionBirthModel
from .modes import ModeSpace
from .radar import RadarModel
from .spawn import SpawnModel


@dataclass(frozen=True)
class TrackerModel:
    """Everything that an engine is told about targets and radars.

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
    """

    modes: ModeSpace
    births: tuple[BirthTerm, ...]
    detection_births: DetectionBirthModel
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[RadarModel, ...]
