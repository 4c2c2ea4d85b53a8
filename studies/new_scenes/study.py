"""Twelve scenes that nothing was tuned on, beside a JIPDA tracker that is told as much.

The tracker has the parameters of a shipped profile with the radars' true values, and once more
learns them from these, as the profiles do. The peer, `peers.integrated`, is told the true radars,
the births and the spread of speeds. Targets out of sight of all radars are neither missed nor
false.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.types import SOURCES, Truth
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.consistency import mahalanobis2
from phd_jdtc_ros.evaluation.metrics import assign, ospa
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.exit_status import ArgumentParser
from phd_jdtc_ros.simulation.scenario import truth_after
from phd_jdtc_ros.study.tracker import estimates_of

from ..peers import integrated
from ..runner import Figures, Goal, Study, cell, goal, table
from .traffic import SCENES, Scene

TOLD, LEARNS, PEER = "told", "learns", "JIPDA, told"
COLUMNS = {
    "ospa": ("OSPA, m", ".3g"),
    "missed": ("missed, %", ".1f"),
    "false": ("false", ".2f"),
    "rms": ("RMS, m", ".3g"),
    "switches": ("switches", ".1f"),
    "nees": ("NEES", ".2f"),
}


def measure(arguments: argparse.Namespace, seed: int) -> Figures:
    """Return the scores of a seed by scene, tracker and source."""
    return {"scenes": {name: _of_scene(name, seed) for name in arguments.scenes}}


def _of_scene(name: str, seed: int) -> Figures:
    rng = np.random.default_rng([seed, *name.encode()])
    scene = SCENES[name](rng)
    reports = scene.detections(seed)
    found: dict[str, dict[str, list[tuple[int, PointSet]]]] = {}
    for tracker in (TOLD, LEARNS):
        estimates, _ = estimates_of(scene.scenario, scene.config(tracker == LEARNS), reports)
        found[tracker] = {
            source: [(each.stamp_ns, PointSet.of(each)) for each in estimates[source]]
            for source in SOURCES
        }
    stamps = sorted(stamp for stamp, _ in found[TOLD][SOURCES[0]])
    peer = integrated.follow(
        scene.scenario, reports, settings_of(scene), [*map(scene.after, stamps)]
    )
    found[PEER] = {
        source: [*zip(stamps, own, strict=True)] for source, own in zip(SOURCES, peer, strict=True)
    }
    return {
        tracker: {source: scores(scene, own) for source, own in sources.items()}
        for tracker, sources in found.items()
    }


def settings_of(scene: Scene) -> integrated.Settings:
    """Return what the peer is told of the targets of a scene."""
    given, kind = scene.parameters, scene.kind
    return integrated.Settings(
        kind.densities,
        given["detection_births.rates"][0],
        given["detection_births.std"][0],
        kind.near,
        given["interval_s"],
        given["lag_s"],
    )


def scores(scene: Scene, found: Sequence[tuple[int, PointSet]]) -> Figures:
    """Return the scores of estimates by their stamps.

    OSPA has the order 2; missed targets are in percent, false ones per stamp, and NEES is that of
    an axis of the position.
    """
    cutoff = scene.kind.cutoff
    identity, switches = IdentitySwitches(cutoff), 0
    distance, squares, consistency = [], [np.zeros(0)], [np.zeros(0)]
    present = missed = false = 0
    for stamp_ns, points in sorted(found, key=lambda each: each[0]):
        time_s = scene.after(stamp_ns)
        truth, own = _in_sight(scene, truth_after(scene.scenario, time_s), points, time_s)
        distance.append(ospa(truth.position, own.position, cutoff, 2.0).distance)
        target, estimate = assign(truth.position, own.position, cutoff, 2.0)
        present += len(truth)
        missed += len(truth) - len(target)
        false += len(own) - len(target)
        error = truth.position[target] - own.position[estimate]
        squares.append((error**2).sum(axis=1))
        spread = None if own.covariance is None else own.covariance[estimate]
        consistency.append(0.5 * mahalanobis2(error, spread))
        known = LabelledPoints(_labels(truth), truth.position)
        switches += identity.add(known, LabelledPoints(_labels(own), own.position), own.coasting)
    return {
        "ospa": float(np.mean(distance)),
        "missed": 100.0 * missed / max(present, 1),
        "false": false / max(len(distance), 1),
        "rms": float(np.sqrt(np.concatenate(squares).mean())),
        "switches": switches,
        "nees": float(np.concatenate(consistency).mean()),
    }


def _labels(points: PointSet) -> IntArray:
    return np.zeros(0, dtype=np.int64) if points.track_id is None else points.track_id


def _in_sight(
    scene: Scene, truth: Truth, points: PointSet, time_s: float
) -> tuple[PointSet, PointSet]:
    """Return the targets in sight, and the estimates without those of other targets."""
    seen = scene.in_sight(truth, time_s)
    target, estimate = assign(truth.position, points.position, scene.kind.cutoff, 2.0)
    hidden = estimate[~seen[target]]
    rest = np.setdiff1d(np.arange(len(points)), hidden)
    return PointSet.of(truth).only(np.flatnonzero(seen)), points.only(rest)


def _ratios(figures: Figures) -> Iterator[tuple[str, str, float]]:
    for name, trackers in figures["scenes"].items():
        for source in SOURCES:
            own, peer = (trackers[tracker][source]["ospa"] for tracker in (TOLD, PEER))
            yield name, source, own / peer


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: the OSPA of the tracker that is told is not above the peer's."""
    return [
        goal(f"{name}, {source}: OSPA by the peer's", ratio, 1.0)
        for name, source, ratio in _ratios(figures)
    ]


def tables(figures: Figures) -> list[Table]:
    """Return the scores of each scene and tracker, filtered / smoothed."""

    def row(scene: str, tracker: str) -> Iterator[str]:
        for name, (_, form) in COLUMNS.items():
            path = ("scenes", scene, tracker)
            both = (cell(figures, [*path, source, name], form) for source in SOURCES)
            yield " / ".join(both)

    rows = [
        (scene if tracker == TOLD else "", tracker, *row(scene, tracker))
        for scene, trackers in figures["scenes"].items()
        for tracker in trackers
    ]
    headings = ("scene", "tracker", *(heading for heading, _ in COLUMNS.values()))
    return [table("new scenes, filtered / smoothed", headings, rows)]


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--scenes", nargs="+", choices=[*SCENES], default=[*SCENES], metavar="SCENE", help="all"
    )


STUDY = Study(
    name="new_scenes",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    goals=goals,
    seed=96000,
    runs=12,
    add_arguments=_add_arguments,
)
