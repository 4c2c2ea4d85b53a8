# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a filter learns of every radar's clutter from scan to scan.

It learns from what no target claims. Births do not count as claims: while the law is wrong, each
false detection of a new kind looks like a newborn target, and would otherwise never be learned.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..arrays import FloatArray
from ..types import Detections
from .clutter_amplitude import Learned
from .radar import RadarModel


@dataclass
class ClutterMemory:
    """What has been learned of the amplitudes of each radar's clutter.

    Parameters
    ----------
    laws : dict of name to Learned
        By radar; of those that have learned something.
    """

    laws: dict[str, Learned] = field(default_factory=dict)

    def informed(self, radar: RadarModel) -> RadarModel:
        """Return a radar with what has been learned of its clutter."""
        law = self.laws.get(radar.name)
        if law is None or not isinstance(radar.clutter_amplitude, Learned):
            return radar
        if law.threshold != radar.threshold:
            law = Learned(radar.threshold, law.count)
        return replace(radar, clutter_amplitude=law)

    def learn(self, radar: RadarModel, detections: Detections, claimed: FloatArray) -> None:
        """Take in what one radar reported.

        Parameters
        ----------
        radar : RadarModel
            As `informed` returned it, or with the threshold raised because it reported too much;
            then nothing is learned, because the detections are the highest ones only.
        detections : Detections
            M of them.
        claimed : array of shape (M,)
            Probability that a known target is the source of each detection.
        """
        law, amplitude = radar.clutter_amplitude, detections.amplitude
        if isinstance(law, Learned) and amplitude is not None and radar.threshold == law.threshold:
            self.laws[radar.name] = law.after(amplitude, 1.0 - claimed)
