import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo import kinds
from phd_jdtc_ros.study.monte_carlo.tasks import perform
from phd_jdtc_ros.tools.monte_carlo import load_study

PACKAGE = Path(kinds.__file__).parents[2]
every_kind = pytest.mark.parametrize("kind", kinds.KINDS)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A copy of the package, used in place of the installed code."""
    copy = tmp_path / PACKAGE.name
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    own = Path(kinds.__file__).relative_to(PACKAGE)
    monkeypatch.setattr(kinds, "__file__", str(copy / own))
    return copy


def code_of(kind):
    """Return the digest of the code as it is now."""
    return kinds.code_of.__wrapped__(kind)


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("particles", "core/smc/filter.py"),
        ("particles", "study/tracker.py"),
        ("gaussian", "study/tracker.py"),
        ("gaussian", "core/gaussian/update.py"),
        ("particles", "study/monte_carlo/scores.py"),
        ("particles", "study/monte_carlo/tasks.py"),
        ("reference", "study/reference.py"),
        ("reference_best", "study/reference.py"),
        ("reference", "study/monte_carlo/scores.py"),
        ("gnn_loud", "study/peers/settings.py"),
        ("gnn_loud", "study/peers/__init__.py"),
        ("jpda", "study/runs.py"),
    ],
)
def test_code_follows_what_the_scores_depend_on(package, kind, path):
    before = code_of(kind)
    with (package / path).open("a") as file:
        file.write("\nADDED = 1\n")

    assert code_of(kind) != before


def test_code_does_not_follow_other_kinds(package):
    before = code_of("particles")
    with (package / "study/peers/settings.py").open("a") as file:
        file.write("\nADDED = 1\n")

    assert code_of("particles") == before


@pytest.mark.parametrize(
    "kind", ["particles", "gaussian", "turning", "reference", "gnn", "plot_kalman"]
)
def test_sources_have_every_module_that_a_kind_imports(kind):
    name = kinds.module_of(kind).__name__
    script = (
        f"import json, sys, {name}; print(json.dumps([m.__file__ for n, m in sys.modules.items()"
        " if n.startswith('phd_jdtc_ros.') and not n.endswith('.study')]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=PACKAGE.parent, capture_output=True, check=True
    )

    assert set(map(Path, json.loads(done.stdout))) <= set(kinds.sources_of(kind))


@pytest.mark.parametrize("kind", kinds.PEERS)
def test_module_of_a_peer_has_a_function_of_its_name(kind):
    assert callable(getattr(kinds.module_of(kind), kind))


def test_perform_runs_every_peer(study_file):
    pytest.importorskip("stonesoup")

    def change(document):
        document["variants"] = {kind: {"kind": kind} for kind in kinds.STONE_SOUP}
        document["goals"] = []

    plan = monte_carlo.plan(load_study(study_file(change), {}), [0])

    for task in plan.tasks:
        outcome = perform(task)
        assert outcome.error == ""
        assert outcome.scores[task.kind].sets == ("all",)
