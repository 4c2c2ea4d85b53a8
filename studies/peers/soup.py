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
    """Return the used parts of Stone Soup by their own names.

    Detections and tracks are `numbered`, from 0 again in each call. Raise `ImportError` if Stone
    Soup is missing, or its version lacks a part.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # It warns of a search tree that is not used.
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
    """Return a subtype of a Stone Soup type whose objects hash by number, in order of creation.

    Stone Soup stores tracks and detections in sets. Their default hashes are addresses, so that the
    order of a set, and with it the rounding, differ from run to run; tracks that come close to each
    other amplify the difference to metres.
    """
    numbers = count()

    class Numbered(base):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            self.number = next(numbers)
            super().__init__(*args, **kwargs)

        def __hash__(self) -> int:
            return self.number

    return Numbered
