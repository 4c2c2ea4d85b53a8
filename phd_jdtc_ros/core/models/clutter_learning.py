"""What a filter learns of every radar's clutter from scan to scan.

It learns from what no target claims. Births do not count as claims: while the law is wrong, each
false detection of a new kind looks like a newborn target, and would otherwise never be learned.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import FloatArray
from ..clutter.amplitude_law import Learned
from ..clutter.map import ClutterMap
from ..clutter.rate import ClutterCount
from ..sensors.polar_radar import RadarModel
from ..types import Detections
from .tracker_model import TrackerModel


@dataclass
class ClutterMemory:
    """What has been learned of the number, the amplitudes and the places of each radar's clutter.

    Parameters
    ----------
    laws : dict of name to Learned
        By radar; of those that have learned something.
    maps : dict of name to ClutterMap
        By radar; of those that have learned something.
    counts : dict of name to ClutterCount
        By radar; of those that have learned something.
    """

    laws: dict[str, Learned] = field(default_factory=dict)
    maps: dict[str, ClutterMap] = field(default_factory=dict)
    counts: dict[str, ClutterCount] = field(default_factory=dict)
    _informed: dict[str, RadarModel] = field(default_factory=dict, init=False, repr=False)

    def informed(self, radar: RadarModel) -> RadarModel:
        """Return a radar with what has been learned of its clutter."""
        law, places = self.laws.get(radar.name), self.maps.get(radar.name)
        if law is not None and isinstance(radar.clutter_amplitude, Learned):
            if law.threshold != radar.threshold:
                law = Learned(radar.threshold, law.count)
            radar = replace(radar, clutter_amplitude=law)
        if places is not None and radar.clutter_map is not None:
            radar = replace(radar, clutter_map=places)
        if radar.clutter_count is not None:
            count = self.counts.get(radar.name, radar.clutter_count)
            radar = replace(radar, clutter_count=count, clutter_rate=count.rate)
        self._informed[radar.name] = radar
        return radar

    def mapped(self, model: TrackerModel) -> TrackerModel:
        """Return a tracker's model whose radars have the maps that were learned."""
        if not self.maps:
            return model
        radars = (
            radar
            if radar.clutter_map is None
            else replace(radar, clutter_map=self.maps.get(radar.name, radar.clutter_map))
            for radar in model.radars
        )
        return replace(model, radars=tuple(radars))

    def learns(self, radar: RadarModel) -> bool:
        """Return whether there is something to learn of the report of a radar as `informed`.

        There is not if the radar stands for a part of a report that was too large.
        """
        law, places = radar.clutter_amplitude, radar.clutter_map
        whole = radar is self._informed.get(radar.name)
        learning = isinstance(law, Learned) or places is not None
        return whole and (learning or radar.clutter_count is not None)

    def learn(
        self, radar: RadarModel, detections: Detections, claimed: FloatArray, still: FloatArray
    ) -> None:
        """Take in what one radar reported.

        Parameters
        ----------
        radar : RadarModel
            That learns.
        detections : Detections
            M of them.
        claimed : array of shape (M,)
            Probability that a known target is the source of each detection.
        still : array of shape (M,)
            Share of that probability that is of targets slower than `clutter_map_speed`; if their
            velocities are not known it is a half, see `stationary`.
        """
        law, places, coverage = radar.clutter_amplitude, radar.clutter_map, detections.coverage
        if isinstance(law, Learned) and detections.amplitude is not None:
            law = law.after(detections.amplitude, 1.0 - claimed)
            self.laws = {**self.laws, radar.name: law}
        turns = 1.0 if coverage is None else coverage.turns
        if not turns:  # who knows how much was looked at
            return
        if radar.clutter_count is not None:
            # Of those that are of no target, what a map does not explain.
            uniform = np.exp(-radar.log_clutter_factor(detections.measurement))
            unclaimed = float(((1.0 - claimed) * uniform).sum())
            count = radar.clutter_count.after(unclaimed, turns)
            self.counts = {**self.counts, radar.name: count}
        if places is not None:
            weight = 1.0 - claimed * (1.0 - still)
            seen = detections.measurement
            world = radar.to_world(seen)
            self.maps = {**self.maps, radar.name: places.after(seen, world, weight, turns)}
