"""The parts of Stone Soup that the peers use."""

from __future__ import annotations

import warnings
from importlib import import_module
from itertools import count
from types import SimpleNamespace
from typing import Any, TypeAlias

REQUIREMENT = "stonesoup>=1.9,<2"
PARTS = {
    "dataassociator.neighbour": ("GNNWith2DAssignment",),
    "dataassociator.probability": ("JPDAwithEHM",),
    "hypothesiser.distance": ("DistanceHypothesiser",),
    "hypothesiser.gaussianmixture": ("GaussianMixtureHypothesiser",),
    "hypothesiser.probability": ("PDAHypothesiser",),
    "initiator.simple": (
        "MultiMeasurementInitiator",
        "SimpleMeasurementInitiator",
        "SinglePointInitiator",
    ),
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

# Stone Soup ships no type information.
Soup: TypeAlias = SimpleNamespace
Part: TypeAlias = Any


def require() -> Soup:
    """Return the parts of Stone Soup that are used, by their own names.

    Its detections and tracks are `numbered`, from 0 anew in each call.

    Raises
    ------
    ImportError
        If Stone Soup is missing, or its version does not have them.
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
    return Soup(**parts | {name: numbered(parts[name]) for name in ("Detection", "Track")})


def numbered(base: Part) -> Part:
    """Return a type like Stone Soup's whose objects hash by number, in the order of their making.

    Stone Soup keeps tracks and detections in sets. By default their hashes are addresses, so that
    a set's order and with it the rounding differ from run to run, which pairs of tracks that come
    together amplify to metres.
    """
    numbers = count()

    class Numbered(base):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            self.number = next(numbers)
            super().__init__(*args, **kwargs)

        def __hash__(self) -> int:
            return self.number

    return Numbered
