# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The kinds of tracker that a study compares: where each is, whether it is here, and its code.

A kind is a tracker as it is tuned: a peer with other settings is a kind of its own, named as the
function of `peers` that runs it.
"""

from __future__ import annotations

import hashlib
import importlib.util
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

PARTICLES, REFERENCE, GNN = "particles", "reference", "gnn"
# These smooth too.
NEAREST_NEIGHBOUR = (GNN, "gnn_loud", "gnn_anywhere")
PEERS = ("gm_phd", *NEAREST_NEIGHBOUR, "jpda")
KINDS = (PARTICLES, REFERENCE, *PEERS)
PEERS_PACKAGE = "stonesoup"


def module_of(kind: str) -> Any:
    """Return the module of a kind; the peers' one is not needed by the others."""
    return import_module(f"..{_module_name(kind)}", __package__)


def _module_name(kind: str) -> str:
    return "peers" if kind in PEERS else kind


def missing(kind: str) -> str | None:
    """Return why a kind cannot be run here, or None."""
    if kind in PEERS and importlib.util.find_spec(PEERS_PACKAGE) is None:
        return f"{PEERS_PACKAGE} is not installed"
    return None


def sources_of(kind: str) -> list[Path]:
    """Return the files that a kind's scores depend on: of its tracker, of tasks and of scoring."""
    package = Path(__file__).parents[2]
    study = package / "study"
    own = study / _module_name(kind)
    return [
        *sorted((package / "core").rglob("*.py")),
        study / "runs.py",
        study / "monte_carlo" / "scores.py",
        study / "monte_carlo" / "tasks.py",
        *(sorted(own.glob("*.py")) if own.is_dir() else [own.with_suffix(".py")]),
    ]


@cache
def code_of(kind: str) -> str:
    """Return a digest of the files that a kind's scores depend on."""
    digest = hashlib.sha256()
    for path in sources_of(kind):
        digest.update(path.name.encode() + path.read_bytes())
    if kind in PEERS and missing(kind) is None:
        digest.update(metadata.version(PEERS_PACKAGE).encode())
    return digest.hexdigest()
