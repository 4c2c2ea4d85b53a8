import json
import subprocess
import sys
from pathlib import Path

import pytest

import studies
from phd_jdtc_ros.study.monte_carlo import kinds
from phd_jdtc_ros.study.monte_carlo.kinds import Kind
from studies import peers

ROOT = Path(studies.__file__).parents[1]


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("particles", "core/smc/filter.py"),
        ("particles", "study/tracker.py"),
        ("gaussian", "core/gaussian/update.py"),
        ("gaussian", "study/monte_carlo/tasks.py"),
        ("reference", "study/reference.py"),
        ("gnn_loud", "study/monte_carlo/scores.py"),
        ("turning", "study/runs.py"),
    ],
)
def test_sources_have_what_the_scores_depend_on(kind, path):
    assert ROOT / "phd_jdtc_ros" / path in peers.KINDS[kind].sources()


def test_peers_have_sources_of_their_own_in_the_repository():
    own = {ROOT / "studies" / "peers" / name for name in ("settings.py", "__init__.py")}
    assert own <= set(peers.KINDS["gnn_loud"].sources())
    assert not own & set(peers.KINDS["particles"].sources())
    assert "python -m studies monte_carlo" in kinds.KINDS["gnn"].missing()
    assert kinds.KINDS["particles"].missing() is None


def test_code_follows_the_sources_of_a_kind(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_tracker.py").write_text("GATE = 3.0\n")
    kind = Kind("own", lambda *_: None, modules=("own_tracker",))
    before = kinds.code_of.__wrapped__(kind)
    (tmp_path / "own_tracker.py").write_text("GATE = 4.0\n")
    assert kinds.code_of.__wrapped__(kind) != before


def test_sources_have_every_module_that_the_kinds_import():
    script = (
        "import json, sys, studies.peers; "
        "print(json.dumps([m.__file__ for n, m in sys.modules.items() if n.partition('.')[0] in "
        "('phd_jdtc_ros', 'studies') and not n.endswith(('_ros', 'studies', '.study'))]))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, check=True)
    # How a study is defined and written does not change its scores.
    of_study = ROOT / "phd_jdtc_ros" / "study" / "monte_carlo"
    found = {path for path in map(Path, json.loads(done.stdout)) if path.parent != of_study}
    assert found <= {*peers.KINDS["gnn"].sources(), ROOT / "phd_jdtc_ros" / "output_files.py"}
