"""The kinds of tracker in a study: module, availability and source files of each.

A kind is a tracker with its settings. A peer with other settings is another kind, named after the
function of `peers` that runs it.
"""

from __future__ import annotations

import hashlib
import importlib.util
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration.engines import ENGINES

# This package's tracker on scans, by the name of its engine.
TRACKERS = tuple(ENGINES)
REFERENCE, GNN = "reference", "gnn"
# References with known association, each with its function in `reference`.
KNOWN_ASSOCIATION = {REFERENCE: "known_association", "reference_best": "best_noise"}
# Kinds for turning radars: this package's tracker through its pipeline, and a peer.
TURNING, PLOT_KALMAN = TURNING_KINDS = ("turning", "plot_kalman")
# Kinds of this package's tracker.
OURS = (*TRACKERS, TURNING)
# Peers with a smoother.
NEAREST_NEIGHBOUR = (GNN, "gnn_loud", "gnn_anywhere")
STONE_SOUP = ("gm_phd", "gm_phd_loud", *NEAREST_NEIGHBOUR, "jpda", "jpda_loud")
PEERS = (*STONE_SOUP, PLOT_KALMAN)
KINDS = (*TRACKERS, TURNING, *KNOWN_ASSOCIATION, *PEERS)
# Kinds with tracker parameters, from which peers take births, classes and the noise of constant
# velocity.
TUNED = (*OURS, *STONE_SOUP)
PEERS_PACKAGE = "stonesoup"


def module_of(kind: str) -> Any:
    """Return the module of a kind; `peers` is imported for peers only."""
    return import_module(f"..{_module_name(kind)}", __package__)


def suits(kind: str, turning: bool) -> bool:
    """Return whether a kind can be run on a case with, or without, turning antennas."""
    return (kind in TURNING_KINDS) == turning


def _module_name(kind: str) -> str:
    if kind in TRACKERS:
        return "tracker"
    if kind in KNOWN_ASSOCIATION:
        return REFERENCE
    return "peers" if kind in PEERS else kind


def missing(kind: str) -> str | None:
    """Return the reason why a kind cannot run on this machine, or None."""
    if kind in STONE_SOUP and importlib.util.find_spec(PEERS_PACKAGE) is None:
        return f"{PEERS_PACKAGE} is not installed"
    return None


def sources_of(kind: str) -> list[Path]:
    """Return the source files that a kind's scores depend on: tracker, tasks and scoring."""
    package = Path(__file__).parents[2]
    study = package / "study"
    tracker = study / _module_name(kind)
    folders = ("calibration", "configuration", "core", "evaluation", "feed", "simulation")
    return [
        *sorted(path for name in folders for path in (package / name).rglob("*.py")),
        package / "quoting.py",
        study / "runs.py",
        study / "turning.py",
        study / "monte_carlo" / "scores.py",
        study / "monte_carlo" / "tasks.py",
        *(sorted(tracker.glob("*.py")) if tracker.is_dir() else [tracker.with_suffix(".py")]),
    ]


@cache
def code_of(kind: str) -> str:
    """Return a digest of the files that a kind's scores depend on."""
    digest = hashlib.sha256()
    for path in sources_of(kind):
        digest.update(path.name.encode() + path.read_bytes())
    if kind in STONE_SOUP and missing(kind) is None:
        digest.update(metadata.version(PEERS_PACKAGE).encode())
    return digest.hexdigest()
