"""Stone Soup's trackers on the same detections: GM-PHD, global nearest neighbour, JPDA.

Stone Soup (https://stonesoup.rtfd.io, PyPI ``stonesoup``) is an optional extra: this module
imports without it, and the peers say what to install. Its predictors, updaters, hypothesisers,
associators, initiators, reducer and smoother do the work; here they are put together, told about
the scenario, and read out.

The peers are told what the tracker of this package is told: place and noise of the radars, the
clutter density, and the birth terms and survival probability of the reference configuration. They
move targets at nearly constant velocity with the reference's noise density; the targets do fly
straight. Both radars are taken in sequence at one stamp.

They are not told classes or amplitudes, for which Stone Soup's trackers have no use. The
probability of detection is the mean of the classes', and every estimate carries class 0: only the
set ``all`` of their scores means anything. What amplitude is worth to such a tracker can be seen
with `raised_threshold`.

Notes
-----
Settings were chosen on the reference scenario by mean OSPA (p = 2, c = 1000 m) of the filter and,
for the nearest neighbour, of the smoother at lag 5; the GM-PHD's on seeds 1000 to 1003, the
others' on 1000 to 1005, 2000 to 2009 and 3000 to 3019, because settings that are best on six runs
lose a target for good in one run of ten:

========  ========================================================================================
tracker   tried
========  ========================================================================================
GM-PHD    merge 0.25 to 16 (2 and below split targets, 6 and above fuse the two parallel ones),
          gate 4 and 5, pruning 1e-5 and 1e-3, extraction 0.3 to 0.6, merging once a scan instead
          of once a radar, merging without Stone Soup's limit of the weight to 1: none better than
          the settings below by more than a few per cent
GNN       gate 3 to 5, 2 to 6 detections to confirm, deletion after 2 to 6 looks missed, tentative
          tracks after 1 to 3, tracks started at the birth places or anywhere, reports of tracks
          that no radar saw, detection thresholds 4.5, 5 and 6
JPDA      as the nearest neighbour; what is good for one is good for the other
========  ========================================================================================

Three things differ from Stone Soup as it comes, each to the peers' advantage:

- Differences of Stone Soup's `Bearing` wrap in gates, updates and association probabilities, but
  its PHD updater takes the likelihood of plain numbers. For the GM-PHD every detection is moved,
  hypothesis by hypothesis, to the turn nearest to the predicted bearing.
- Its deleters count stamps, so they cannot tell one missed radar from two at the same stamp;
  `LooksMissed` counts looks.
- Its mixture tracker takes for associated every detection that is likelier than a miss, so with
  JPDA a target beside a track never starts one (mean OSPA above 220 m instead of 130). Here a track
  claims its most probable detection only.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from importlib import import_module
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np

from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.filter import TrackerModel
from phd_jdtc_ros.core.motion import VX, VY, ConstantVelocity, X, Y
from phd_jdtc_ros.core.radar import RadarModel
from phd_jdtc_ros.core.types import Detections, FloatArray, Scan

from .runs import SimulatedRun, Tracks

REQUIREMENT = "stonesoup>=1.9,<2"
PARTS = {
    "dataassociator.neighbour": ("GNNWith2DAssignment",),
    "dataassociator.probability": ("JPDAwithEHM",),
    "hypothesiser.distance": ("DistanceHypothesiser",),
    "hypothesiser.gaussianmixture": ("GaussianMixtureHypothesiser",),
    "hypothesiser.probability": ("PDAHypothesiser",),
    "initiator.simple": ("MultiMeasurementInitiator", "SinglePointInitiator"),
    "measures": ("SquaredMahalanobis",),
    "mixturereducer.gaussianmixture": ("GaussianMixtureReducer",),
    "models.measurement.nonlinear": ("CartesianToBearingRange",),
    "models.transition.linear": ("CombinedLinearGaussianTransitionModel", "ConstantVelocity"),
    "predictor.kalman": ("ExtendedKalmanPredictor",),
    "smoother.kalman": ("ExtendedKalmanSmoother",),
    "tracker.simple": ("MultiTargetMixtureTracker", "MultiTargetTracker"),
    "types.angle": ("Bearing",),
    "types.array": ("StateVector",),
    "types.detection": ("Detection",),
    "types.state": ("GaussianState", "TaggedWeightedGaussianState"),
    "types.track": ("Track",),
    "types.update": ("Update",),
    "updater.kalman": ("ExtendedKalmanUpdater",),
    "updater.pointprocess": ("PHDUpdater",),
}

# Stone Soup's state is [x, vx, y, vy]; these are its members in ours, and its positions.
STATE = [X, VX, Y, VY]
POSITION = [0, 2]
# Stone Soup wants calendar times; only differences matter.
EPOCH = datetime(2000, 1, 1)

# Stone Soup ships no types; the aliases say what is meant.
Soup: TypeAlias = SimpleNamespace
Part: TypeAlias = Any


@dataclass(frozen=True)
class PhdSettings:
    """How the GM-PHD is tuned.

    Parameters
    ----------
    gate : float
        Standard deviations of the innovation.
    prune : float
        Least weight of a component.
    merge : float
        Squared Mahalanobis distance below which components merge.
    most : int
        Components kept.
    extract : float
        Weight above which a component is a target.
    """

    gate: float
    prune: float
    merge: float
    most: int
    extract: float


@dataclass(frozen=True)
class TrackSettings:
    """How a tracker that keeps tracks is tuned.

    A look is one radar's report of one scan.

    Parameters
    ----------
    gate : float
        Standard deviations of the innovation.
    points : int
        Detections that confirm a tentative track.
    tentative_looks, looks : int
        A tentative and a confirmed track end when so many looks in a row have missed them.
    birth_gate : float or None
        A detection starts a track within so many standard deviations of a birth place; None for
        anywhere.
    """

    gate: float
    points: int
    tentative_looks: int
    looks: int
    birth_gate: float | None


GM_PHD = PhdSettings(gate=5.0, prune=1e-5, merge=4.0, most=100, extract=0.5)
AT_BIRTH_PLACES = TrackSettings(gate=3.5, points=4, tentative_looks=2, looks=5, birth_gate=4.0)
# For those who do not know where targets appear: later to confirm, several times slower.
ANYWHERE = TrackSettings(gate=3.0, points=6, tentative_looks=2, looks=3, birth_gate=None)
# The same after `raised_threshold(run, LOUD_THRESHOLD)`, which leaves hardly any clutter.
LOUD_THRESHOLD = 5.0
LOUD = TrackSettings(gate=4.0, points=2, tentative_looks=2, looks=4, birth_gate=None)


def require() -> Soup:
    """Return the parts of Stone Soup that are used, by their own names.

    Raises
    ------
    ImportError
        Where Stone Soup is missing, or too old or new to have them.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about a search tree that is not used here
            parts = {
                name: getattr(import_module(f"stonesoup.{module}"), name)
                for module, names in PARTS.items()
                for name in names
            }
    except (ImportError, AttributeError) as error:
        raise ImportError(
            f"the peers need Stone Soup ({error}): pip install '{REQUIREMENT}'"
        ) from error
    return Soup(**parts)


def gm_phd(run: SimulatedRun, settings: PhdSettings = GM_PHD) -> Tracks:
    """Return the estimates of Stone Soup's Gaussian-mixture PHD filter, at lag 0.

    Parameters
    ----------
    run : SimulatedRun
    settings : PhdSettings

    Returns
    -------
    Tracks
        Components of weight above ``settings.extract``; all of class 0.

    Raises
    ------
    ImportError
        Without Stone Soup.

    Notes
    -----
    Stone Soup applies survival in its updater, which would be once a radar: here only the first
    radar of a scan does. It also drops components tagged as births when the first radar misses
    them; ours are not tagged so, and their weight makes up for the survival applied to them.
    """
    kitchen = Kitchen.of(run)
    soup = kitchen.soup
    hypothesiser = soup.GaussianMixtureHypothesiser(
        kitchen.hypothesiser(settings.gate), order_by_detection=True
    )
    reducer = soup.GaussianMixtureReducer(
        prune_threshold=settings.prune,
        merge_threshold=settings.merge,
        max_number_components=settings.most,
    )
    mixture: list[Part] = []
    reports = []
    for stamp, looks in kitchen.scans():
        mixture = mixture + kitchen.births(stamp)
        survival = kitchen.survival_probability
        for radar, detections in looks:
            updater = soup.PHDUpdater(
                updater=kitchen.updater,
                clutter_spatial_density=clutter_density(radar),
                prob_detection=kitchen.detection_probability(radar),
                prob_survival=survival,
            )
            hypotheses = hypothesiser.hypothesise(mixture, detections, stamp)
            for hypothesis in (h for multiple in hypotheses[:-1] for h in multiple):
                hypothesis.measurement = nearest_turn(soup, hypothesis)
            mixture = reducer.reduce(list(updater.update(hypotheses).components))
            survival = 1.0
        reports.append(point_set(c for c in mixture if c.weight > settings.extract))
    return {0: reports}


def gnn(
    run: SimulatedRun, lags: Iterable[int] = (0,), settings: TrackSettings = AT_BIRTH_PLACES
) -> Tracks:
    """Return the estimates of global nearest neighbour tracking, smoothed where the lag asks.

    Parameters
    ----------
    run : SimulatedRun
    lags : iterable of int
        0 is the extended Kalman filter; L above is Stone Soup's `ExtendedKalmanSmoother`
        (Rauch-Tung-Striebel) over the L scans that follow, fewer at the end of the run.
    settings : TrackSettings

    Returns
    -------
    Tracks
        See `at_lag` for which tracks are reported when; all of class 0.

    Raises
    ------
    ImportError
        Without Stone Soup.
    """
    kitchen = Kitchen.of(run)
    soup = kitchen.soup
    associator = soup.GNNWith2DAssignment(kitchen.hypothesiser(settings.gate))
    history = follow(kitchen, soup.MultiTargetTracker, lambda _: associator, settings)
    return {lag: at_lag(kitchen, history, lag) for lag in lags}


def jpda(run: SimulatedRun, settings: TrackSettings = AT_BIRTH_PLACES) -> Tracks:
    """Return the estimates of joint probabilistic data association, at lag 0.

    Parameters
    ----------
    run : SimulatedRun
    settings : TrackSettings

    Returns
    -------
    Tracks
        See `at_lag` for which tracks are reported when; all of class 0.

    Raises
    ------
    ImportError
        Without Stone Soup.

    Notes
    -----
    The association probabilities are exact (`JPDAwithEHM`). Tentative tracks are held by nearest
    neighbour, as Stone Soup's examples do.
    """
    kitchen = Kitchen.of(run)
    soup = kitchen.soup

    def associator(radar: RadarModel) -> Part:
        return soup.JPDAwithEHM(
            soup.PDAHypothesiser(
                predictor=kitchen.predictor,
                updater=kitchen.updater,
                clutter_spatial_density=clutter_density(radar),
                prob_detect=kitchen.detection_probability(radar),
                prob_gate=1.0 - math.exp(-0.5 * settings.gate**2),
            )
        )

    history = follow(kitchen, soup.MultiTargetMixtureTracker, associator, settings)
    return {0: at_lag(kitchen, history, 0)}


def raised_threshold(run: SimulatedRun, threshold: float) -> SimulatedRun:
    """Return the run as radars with a higher detection threshold would have reported it.

    Parameters
    ----------
    run : SimulatedRun
    threshold : float
        On the amplitude, at least that of every radar.

    Raises
    ------
    ValueError
        For a lower one.
    """
    lowest = max(radar.threshold for radar in run.scenario.radars)
    if threshold < lowest:
        raise ValueError(f"threshold: {threshold} given, must be at least {lowest}")
    # Clutter envelopes are Rayleigh: memoryless in their square.
    radars = tuple(
        replace(
            radar,
            threshold=threshold,
            clutter_rate=radar.clutter_rate * math.exp(0.5 * (radar.threshold**2 - threshold**2)),
        )
        for radar in run.scenario.radars
    )
    scans, sources = [], []
    for scan, source in zip(run.scans, run.sources, strict=True):
        heard = [np.asarray(d.amplitude) > threshold for d in scan.detections]
        reports = [
            Detections(d.measurement[mask], d.amplitude[mask])
            for d, mask in zip(scan.detections, heard, strict=True)
        ]
        scans.append(Scan(scan.stamp_ns, tuple(reports)))
        sources.append(tuple(s[mask] for s, mask in zip(source, heard, strict=True)))
    return replace(
        run,
        scenario=replace(run.scenario, radars=radars),
        scans=tuple(scans),
        sources=tuple(sources),
    )


@dataclass(frozen=True)
class Kitchen:
    """A run, what is known about it, and the parts of Stone Soup that both give.

    Parameters
    ----------
    soup : Soup
    run : SimulatedRun
    model : TrackerModel
        Of the reference configuration; the radars are the run's own.
    predictor, updater : Part
        Of Stone Soup: extended Kalman, constant velocity.
    """

    soup: Soup
    run: SimulatedRun
    model: TrackerModel
    predictor: Part
    updater: Part

    @staticmethod
    def of(run: SimulatedRun) -> Kitchen:
        """Return the kitchen for a run."""
        soup = require()
        model = resolve({}).model
        straight = next(m for m in model.modes.motions if isinstance(m, ConstantVelocity))
        axis = soup.ConstantVelocity(straight.noise_density)
        motion = soup.CombinedLinearGaussianTransitionModel([axis, axis])
        predictor = soup.ExtendedKalmanPredictor(motion)
        return Kitchen(soup, run, model, predictor, soup.ExtendedKalmanUpdater(None))

    @property
    def intervals(self) -> float:
        """The run's interval in units of the one that rates and probabilities are given for."""
        return self.run.scenario.interval_s / self.model.modes.interval_s

    @property
    def survival_probability(self) -> float:
        """Probability to live on for a scan, mean of the classes."""
        nominal = np.mean([c.survival_probability for c in self.model.modes.classes])
        return float(nominal**self.intervals)

    def detection_probability(self, radar: RadarModel) -> float:
        """Return p_D, mean of the classes."""
        return float(radar.class_detection_probability(self.model.modes.classes).mean())

    def hypothesiser(self, gate: float) -> Part:
        """Return a gated hypothesiser by squared Mahalanobis distance of the innovation."""
        return self.soup.DistanceHypothesiser(
            predictor=self.predictor,
            updater=self.updater,
            measure=self.soup.SquaredMahalanobis(),
            missed_distance=gate**2,
        )

    def places(self, stamp: datetime) -> list[Part]:
        """Return the birth places as Gaussian states."""
        return [
            self.soup.GaussianState(
                term.mean[STATE].reshape(-1, 1), np.diag(term.std[STATE] ** 2), timestamp=stamp
            )
            for term in self.model.births
        ]

    def births(self, stamp: datetime) -> list[Part]:
        """Return the birth terms as mixture components to which survival is yet to be applied."""
        per_term = [
            float(term.rate.sum()) * self.intervals / self.survival_probability
            for term in self.model.births
        ]
        return [
            self.soup.TaggedWeightedGaussianState(
                place.state_vector, place.covar, timestamp=stamp, weight=weight
            )
            for place, weight in zip(self.places(stamp), per_term, strict=True)
        ]

    def scans(self) -> Iterator[tuple[datetime, list[tuple[RadarModel, set[Part]]]]]:
        """Yield every scan's stamp and, radar by radar, its detections."""
        soup, radars = self.soup, self.run.scenario.radars
        sensors = [measurement_model(soup, radar) for radar in radars]
        for scan in self.run.scans:
            stamp = EPOCH + timedelta(microseconds=scan.stamp_ns / 1000)
            looks = [
                (radar, {detection(soup, z, stamp, sensor) for z in report.measurement})
                for radar, sensor, report in zip(radars, sensors, scan.detections, strict=True)
                if report is not None
            ]
            yield stamp, looks


def measurement_model(soup: Soup, radar: RadarModel) -> Part:
    """Return Stone Soup's model of a radar: (bearing, range)."""
    return soup.CartesianToBearingRange(
        ndim_state=len(STATE),
        mapping=POSITION,
        noise_covar=np.diag([radar.azimuth_std**2, radar.range_std**2]),
        translation_offset=soup.StateVector(radar.position),
        rotation_offset=soup.StateVector([0.0, 0.0, radar.yaw]),
    )


def detection(soup: Soup, measurement: FloatArray, stamp: datetime, sensor: Part) -> Part:
    """Return Stone Soup's detection of a (range, azimuth)."""
    radius, azimuth = measurement
    return soup.Detection(
        soup.StateVector([soup.Bearing(azimuth), radius]), timestamp=stamp, measurement_model=sensor
    )


def clutter_density(radar: RadarModel) -> float:
    """Return false detections a radian and metre; a trace of them where there are none."""
    rate = max(radar.clutter_rate, 1e-9)
    return rate / (2.0 * math.pi * radar.clutter_max_range)


def nearest_turn(soup: Soup, hypothesis: Part) -> Part:
    """Return a hypothesis' detection, its bearing a plain number less than pi from the predicted.

    The prediction is Stone Soup's, in [-pi, pi); the bearing returned may lie outside.
    """
    seen = hypothesis.measurement
    predicted = float(hypothesis.measurement_prediction.state_vector[0, 0])
    off = math.remainder(float(seen.state_vector[0, 0]) - predicted, 2.0 * math.pi)
    return soup.Detection(
        soup.StateVector([predicted + off, seen.state_vector[1, 0]]),
        timestamp=seen.timestamp,
        measurement_model=seen.measurement_model,
    )


def point_set(states: Iterable[Part]) -> PointSet:
    """Return the positions of Stone Soup's states, of class 0."""
    rows = [np.asarray(state.state_vector, dtype=float)[POSITION, 0] for state in states]
    return PointSet(np.reshape(rows, (-1, 2)), np.zeros(len(rows), dtype=np.int64))


@dataclass(frozen=True)
class BirthPlaces:
    """An initiator for Stone Soup: detections near a birth place start a track from its prior.

    Parameters
    ----------
    kitchen : Kitchen
    gate : float
        Standard deviations of the innovation.
    """

    kitchen: Kitchen
    gate: float

    def initiate(self, detections: set[Part], timestamp: datetime) -> set[Part]:
        """Return new tracks."""
        soup, updater = self.kitchen.soup, self.kitchen.updater
        measure = soup.SquaredMahalanobis()
        places = self.kitchen.places(timestamp)
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
class Nobody:
    """An initiator for Stone Soup that starts no tracks."""

    def initiate(self, detections: set[Part], timestamp: datetime) -> set[Part]:
        """Return no tracks."""
        return set()


@dataclass(frozen=True)
class LooksMissed:
    """A deleter for Stone Soup: tracks end when so many looks in a row have missed them.

    Parameters
    ----------
    soup : Soup
    looks : int
    """

    soup: Soup
    looks: int

    def delete_tracks(self, tracks: set[Part]) -> set[Part]:
        """Return those of `tracks` that end."""
        return {
            track
            for track in tracks
            if not any(isinstance(s, self.soup.Update) for s in track.states[-self.looks :])
        }


def initiator(kitchen: Kitchen, settings: TrackSettings) -> Part:
    """Return Stone Soup's M-of-N initiator over tracks started as the settings say."""
    soup = kitchen.soup
    # Where tracks start anywhere, the velocity is a birth term's; the position is the detection's.
    velocity = np.diag(kitchen.model.births[0].std[STATE] ** 2)
    gate = settings.birth_gate
    return soup.MultiMeasurementInitiator(
        prior_state=soup.GaussianState(np.zeros((len(STATE), 1)), velocity),
        deleter=LooksMissed(soup, settings.tentative_looks),
        data_associator=soup.GNNWith2DAssignment(kitchen.hypothesiser(settings.gate)),
        updater=kitchen.updater,
        min_points=settings.points,
        initiator=None if gate is None else BirthPlaces(kitchen, gate),
    )


@dataclass(frozen=True)
class History:
    """Which tracks a tracker has confirmed.

    Parameters
    ----------
    stamps : list of datetime, one a scan
    confirmed : dict
        Track to the scan that confirmed it.
    """

    stamps: list[datetime]
    confirmed: dict[Part, int]


def follow(
    kitchen: Kitchen,
    tracker_type: Part,
    associator: Callable[[RadarModel], Part],
    settings: TrackSettings,
) -> History:
    """Run one of Stone Soup's trackers.

    Parameters
    ----------
    kitchen : Kitchen
    tracker_type : Part
        `MultiTargetTracker` or `MultiTargetMixtureTracker`.
    associator : callable
        The data associator for a radar.
    settings : TrackSettings
    """
    tracker = tracker_type(
        initiator=Nobody(),
        deleter=LooksMissed(kitchen.soup, settings.looks),
        detector=None,
        data_associator=None,
        updater=kitchen.updater,
    )
    start = initiator(kitchen, settings)
    history = History([], {})
    for scan, (stamp, looks) in enumerate(kitchen.scans()):
        for radar, detections in looks:
            tracker.data_associator = associator(radar)
            tracker.update_tracker(stamp, detections)
            claimed = {claim(kitchen.soup, track) for track in tracker.tracks}
            tracker.tracks.update(start.initiate(detections - claimed, stamp))
        history.stamps.append(stamp)
        for track in tracker.tracks:
            history.confirmed.setdefault(track, scan)
    return history


def claim(soup: Soup, track: Part) -> Part | None:
    """Return the detection that most probably is the track's, or None after a miss."""
    if not isinstance(track.state, soup.Update):
        return None
    hypothesis = track.state.hypothesis
    if hasattr(hypothesis, "measurement"):
        return hypothesis.measurement
    return max(hypothesis, key=lambda one: one.probability).measurement


def at_lag(kitchen: Kitchen, history: History, lag: int) -> list[PointSet]:
    """Return every scan's tracks as they are known `lag` scans later.

    A track is reported from its first to its last detection, once it is confirmed: not while it
    coasts towards deletion, but across a gap that a later detection has closed. What is known
    later includes tracks confirmed, and gaps closed, in between.
    """
    soup, stamps = kitchen.soup, history.stamps
    smoother = soup.ExtendedKalmanSmoother(kitchen.predictor.transition_model)
    reports = []
    for scan, stamp in enumerate(stamps):
        until = min(scan + lag, len(stamps) - 1)
        known = [track for track, since in history.confirmed.items() if since <= until]
        found = []
        for track in known:
            states = [s for s in track.states if s.timestamp <= stamps[until]]
            seen = [s.timestamp for s in states if isinstance(s, soup.Update)]
            if seen[0] <= stamp <= seen[-1]:
                before = sum(s.timestamp <= stamp for s in states) - 1
                found.append(smoother.smooth(soup.Track(states[before:])).states[0])
        reports.append(point_set(found))
    return reports
