"""All studies at once, and which there are."""

import json
import sys

import pytest

from phd_jdtc_ros.exit_status import FAILED, INTERRUPTED, OK
from phd_jdtc_ros.tools import monte_carlo
from studies import command

PRINTED = "import sys; print('the rest'); sys.exit(int(sys.argv[-1].endswith('fails')))"


@pytest.fixture
def quick(monkeypatch):
    """A Monte Carlo study that writes one goal, and other studies that print a line."""
    seen = []

    def main(argv, busy, kinds):
        out = argv[argv.index("--out") + 1]
        seen.append((argv, busy()))
        (command.Path(out) / "summary.json").write_text(json.dumps({"goals": [{"name": "own"}]}))
        return 0

    popen = command.subprocess.Popen
    monkeypatch.setattr(monte_carlo, "main", main)
    monkeypatch.setattr(
        command.subprocess,
        "Popen",
        lambda given, **options: popen([sys.executable, "-c", PRINTED, given[-1]], **options),
    )
    return seen


def test_all_studies_run_at_once_and_are_shown_at_the_end(quick, tmp_path, capsys):
    assert command.main(["all", "--runs", "7", "--out", str(tmp_path)]) == 0
    ((argv, busy),) = quick
    assert argv == ["--runs", "7", "--out", str(tmp_path)]
    assert busy == 1
    assert capsys.readouterr().out == "the rest\n"


def test_all_studies_fail_with_one_of_them(quick, tmp_path):
    out = tmp_path / "fails"
    out.mkdir()
    assert command.main(["all", "--out", str(out)]) == 1


def test_goals_of_studies_join_those_of_the_summary(quick, tmp_path, monkeypatch):
    (tmp_path / "madap.json").write_text(json.dumps({"goals": [{"name": "of before"}]}))
    goals = {"goals": [{"name": "of now"}]}
    written = (
        f"import pathlib; [pathlib.Path({str(tmp_path)!r}, f'{{n}}.json').write_text("
        f"{json.dumps(goals)!r}) for n in ('madap', 'hours')]"
    )
    monkeypatch.setattr(sys.modules[__name__], "PRINTED", written)
    assert command.main(["all", "--out", str(tmp_path)]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    # The published benchmark's rows do not.
    assert [goal["name"] for goal in summary["goals"]] == ["own", "of now"]


@pytest.fixture
def endless(quick, monkeypatch):
    """Return a function that sets how the Monte Carlo study ends, beside others that do not.

    It returns the list of functions that say how many others run.
    """
    monkeypatch.setattr(sys.modules[__name__], "PRINTED", "import time; time.sleep(100)")
    asked = []

    def set_main(end):
        def main(argv, busy, kinds):
            asked.append(busy)
            return end()

        monkeypatch.setattr(monte_carlo, "main", main)
        return asked

    return set_main


def test_other_studies_end_with_the_one_they_are_beside(endless, tmp_path):
    def fail():
        raise RuntimeError

    asked = endless(fail)
    with pytest.raises(RuntimeError):
        command.main(["all", "--out", str(tmp_path)])
    assert asked[0]() == 0
    asked = endless(lambda: INTERRUPTED)
    assert command.main(["all", "--out", str(tmp_path)]) == INTERRUPTED
    assert asked[0]() == 0


def test_no_study_follows_one_that_was_interrupted(tmp_path, monkeypatch):
    begun, statuses = [], iter([OK, FAILED, INTERRUPTED])

    def run(study, argv):
        begun.append(study.name)
        return next(statuses)

    monkeypatch.setattr(command.runner, "run", run)
    assert command.main(["rest", "--out", str(tmp_path)]) == INTERRUPTED
    assert begun == [command.study_of(name).name for name in command.REST[:3]]


@pytest.mark.parametrize("name", command.STUDIES)
def test_every_study_describes_itself(name, capsys):
    assert command.study_of(name).name == name
    with pytest.raises(SystemExit) as ended:
        command.main([name, "--help"])
    assert ended.value.code == 0
    assert f"usage: studies {name}" in capsys.readouterr().out


def test_an_unknown_study_is_refused_with_all_names(capsys):
    assert command.main(["seam"]) == 2
    said = capsys.readouterr().err
    assert "unknown study 'seam'" in said
    assert "monte_carlo, autoferry_bags, madap, registration, handover" in said
