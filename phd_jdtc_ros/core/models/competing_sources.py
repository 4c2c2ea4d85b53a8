"""What explains a radar's detections beside the known targets: clutter and unknown targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.polar_radar import RadarModel
from ..types import Detections
from . import detection_birth
from .detection_birth import Newborn
from .tracker_model import TrackerModel


@dataclass(frozen=True)
class OtherSources:
    """The intensity of clutter and of unknown targets at each detection.

    Parameters
    ----------
    log_scale : array of shape (M,)
        Log of what the intensities, and the likelihoods of the known targets, are divided by: the
        largest of them. The clutter density underflows above an amplitude of 38.
    intensity : array of shape (1 + C, M), or (1, M) without births at detections
        Of clutter, and of unknown targets by class.
    """

    log_scale: FloatArray
    intensity: FloatArray

    @property
    def total(self) -> FloatArray:
        """Intensity of all of them, shape (M,)."""
        total: FloatArray = self.intensity.sum(axis=0)
        return total

    def newborn(
        self,
        claimed: FloatArray,
        radar: RadarModel,
        detections: Detections,
        model: TrackerModel,
        share: float = 1.0,
    ) -> Newborn | None:
        """Return the unknown targets' part of what no known target claims.

        Parameters
        ----------
        claimed : array of shape (M,)
            Probability that a known target is the source of each detection.
        radar : RadarModel
        detections : Detections
        model : TrackerModel
        share : float
            Of the radar's detections that were looked at; see `detection_limit.thinned`.

        Returns
        -------
        Newborn or None
            None if births at detections are disabled.
        """
        if not model.detection_births.enabled:
            return None
        total = np.where(self.total > 0.0, self.total, 1.0)
        unknown = (1.0 - claimed) * self.intensity[1:] / total
        return detection_birth.newborn(radar, detections, unknown.T, model.detection_births, share)


def other_sources(
    detections: Detections,
    radar: RadarModel,
    model: TrackerModel,
    dt: float,
    column: IntArray,
    log_likelihood: FloatArray,
    earlier: Sequence[Newborn] = (),
    log_clutter: FloatArray | float = 0.0,
    log_unknown: FloatArray | float = 0.0,
) -> OtherSources:
    """Return the other sources of one radar's detections.

    Parameters
    ----------
    detections : Detections
    radar : RadarModel
    model : TrackerModel
    dt : float
        True interval since the previous scan, seconds.
    column : int array of shape (P,)
        The detection of each pair with a known target.
    log_likelihood : array of shape (P,)
        Log p_D L_z of each pair.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier radars.
    log_clutter, log_unknown : arrays of shape (M,) or floats
        Log of what the intensities of clutter and of unknown targets at each detection are
        multiplied by.
    """
    log_other = radar.log_clutter_intensity(detections)[None] + log_clutter
    if model.detection_births.enabled:
        log_birth = model.detection_births.log_intensity(
            detections, radar, model.modes, dt, earlier
        )
        log_other = np.concatenate([log_other, log_birth + log_unknown])
    scale = log_other.max(axis=0)
    np.maximum.at(scale, column, log_likelihood)
    return OtherSources(scale, np.exp(log_other - scale))
