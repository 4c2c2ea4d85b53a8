# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The kinds of tracker that a study compares: where each is, whether it is here, and its code.

A kind is a tracker as it is tuned: a peer with other settings is a kind of its own, named as the
function of `peers` that runs it.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

OURS, REFERENCE, GNN = "ours", "reference", "gnn"
# These smooth too.
NEAREST_NEIGHBOUR = (GNN, "gnn_loud", "gnn_anywhere")
PEERS = ("gm_phd", *NEAREST_NEIGHBOUR, "jpda")
KINDS = (OURS, REFERENCE, *PEERS)
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
        *sorted((package / "core").glob("*.py")),
        study / "runs.py",
        study / "monte_carlo" / "scores.py",
        study / "monte_carlo" / "tasks.py",
        *(sorted(own.glob("*.py")) if own.is_dir() else [own.with_suffix(".py")]),
    ]


@cache
def code_of(kind: str) -> str:
    """Return a digest of the code that a kind's scores depend on.

    Comments and docstrings do not count, so that editing them keeps stored results.
    """
    digest = hashlib.sha256()
    for path in sources_of(kind):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [n for n in body if not _is_text(n)]
        digest.update(f"{path.parent.name}/{path.name} {ast.dump(tree)}".encode())
    if kind in PEERS and missing(kind) is None:
        digest.update(metadata.version(PEERS_PACKAGE).encode())
    return digest.hexdigest()


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
