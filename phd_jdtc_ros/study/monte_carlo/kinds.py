"""The kinds of tracker that a study compares: where each is, whether it is here, and its code."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

OURS, REFERENCE, GM_PHD, GNN, JPDA = KINDS = ("ours", "reference", "gm_phd", "gnn", "jpda")
PEERS = (GM_PHD, GNN, JPDA)
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


@cache
def code_of(kind: str) -> str:
    """Return a digest of the code that a kind's estimates depend on.

    Comments and docstrings do not count, so that editing them keeps stored results.
    """
    study = Path(__file__).parents[1]
    own = study / f"{_module_name(kind)}.py"
    paths = [*sorted((study.parent / "core").glob("*.py")), study / "runs.py", own]
    digest = hashlib.sha256()
    for path in paths:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                node.body = [n for n in body if not _is_text(n)]
        digest.update(f"{path.name} {ast.dump(tree)}".encode())
    if kind in PEERS and missing(kind) is None:
        digest.update(metadata.version(PEERS_PACKAGE).encode())
    return digest.hexdigest()


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
