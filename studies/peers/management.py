"""Track initiation and deletion, with Stone Soup's M-of-N initiator."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from .conversion import STATE
from .problem import Problem
from .settings import TrackSettings
from .soup import Part, Soup


def initiator(problem: Problem, settings: TrackSettings) -> Part:
    """Return Stone Soup's M-of-N initiator for tracks started according to the settings."""
    soup = problem.soup
    gate = settings.birth_gate
    prior = soup.GaussianState(np.zeros((len(STATE), 1)), problem.start_covariance)
    return soup.MultiMeasurementInitiator(
        prior_state=prior,
        deleter=LooksMissed(soup, settings.tentative_looks),
        data_associator=soup.GNNWith2DAssignment(problem.hypothesiser(settings.gate)),
        updater=problem.updater,
        min_points=settings.points,
        initiator=NumberedTracks(
            soup,
            soup.SimpleMeasurementInitiator(prior) if gate is None else BirthPlaces(problem, gate),
        ),
    )


@dataclass(frozen=True)
class NumberedTracks:
    """An initiator for Stone Soup that wraps another and makes tracks of the numbered type."""

    soup: Soup
    initiator: Part

    def initiate(self, detections: set[Part], timestamp: datetime) -> set[Part]:
        """Return new tracks."""
        # Detections are taken one at a time, because a set of unnumbered tracks has no reproducible
        # order.
        started = (
            track
            for detection in detections
            for track in self.initiator.initiate({detection}, timestamp)
        )
        return {self.soup.Track(track.states) for track in started}


@dataclass(frozen=True)
class BirthPlaces:
    """An initiator for Stone Soup: detections near a birth place start a track from its prior."""

    problem: Problem
    gate: float  # Gate in standard deviations of the innovation

    def initiate(self, detections: set[Part], timestamp: datetime) -> set[Part]:
        """Return new tracks."""
        soup, updater = self.problem.soup, self.problem.updater
        measure = soup.SquaredMahalanobis()
        places = self.problem.places(timestamp)
        tracks: set[Part] = set()
        for seen in detections:
            distance = [
                measure(updater.predict_measurement(place, seen.measurement_model), seen)
                for place in places
            ]
            nearest = int(np.argmin(distance))
            if distance[nearest] < self.gate**2:
                start = soup.SinglePointInitiator(places[nearest], updater=updater)
                tracks |= start.initiate({seen}, timestamp)
        return tracks


@dataclass(frozen=True)
class NoInitiator:
    """An initiator for Stone Soup that starts no tracks."""

    def initiate(self, detections: set[Part], timestamp: datetime) -> set[Part]:
        """Return no tracks."""
        return set()


@dataclass(frozen=True)
class LooksMissed:
    """A deleter for Stone Soup: a track ends after a number of consecutive missed looks."""

    soup: Soup
    looks: int

    def delete_tracks(self, tracks: set[Part]) -> set[Part]:
        """Return the tracks that end."""
        return {
            track
            for track in tracks
            if not any(isinstance(s, self.soup.Update) for s in track.states[-self.looks :])
        }
