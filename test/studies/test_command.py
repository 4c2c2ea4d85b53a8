"""The command of all studies, and their runner: seeds, goals, files and exit statuses."""

import json
import sys

import pytest

from phd_jdtc_ros.exit_status import FAILED, INTERRUPTED, OK
from phd_jdtc_ros.tools import monte_carlo
from studies import command, runner
from studies.runner import Study, StudyError, goal

PRINTED = "import sys; print('the rest'); sys.exit(int(sys.argv[-1].endswith('fails')))"
DRAWN = {3: 1.0, 4: 3.0}


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


def study(**changed):
    given = {
        "name": "drawn",
        "purpose": "A study.",
        "measure": lambda arguments, seed: {"of": {"value": DRAWN[seed]}, "names": ["a"]},
        "tables": lambda found: [f"value {found['of']['value']}"],
        "goals": lambda found: [goal("value", found["of"]["value"], 2.5)],
        "seed": 3,
    }
    return Study(**{**given, **changed})


def read(out, name="drawn"):
    return json.loads((out / f"{name}.json").read_text())


def test_a_run_writes_figures_and_goals_and_shows_them(tmp_path, capsys):
    assert runner.run(study(), ["--out", str(tmp_path)]) == 0
    found = read(tmp_path)
    assert (found["seeds"], found["of"], found["names"]) == ([3], {"value": 1.0}, ["a"])
    assert found["goals"] == [
        {"name": "value", "value": 1.0, "goal": 2.5, "at_most": True, "reached": True}
    ]
    assert "value 1.0" in capsys.readouterr().out
    assert not (tmp_path / "summary.json").exists()


def test_runs_give_the_means_of_figures_and_of_goals(tmp_path):
    given = ["--runs", "2", "--out", str(tmp_path)]
    # The largest of errors is that of each run, and no error of a mean.
    goals = {"goals": lambda found: [goal("value", abs(found["of"]["value"] - 2.0), 0.5)]}
    assert runner.run(study(**goals), given) == 0
    found = read(tmp_path)
    assert (found["of"], found["names"]) == ({"value": 2.0}, ["a"])
    (only,) = found["goals"]
    assert (only["value"], only["at_most"], only["reached"]) == (1.0, True, False)


def test_means_and_goals_without_values_are_unknown():
    found = runner.mean([{"a": 1.0, "b": None}, {"a": 2.0, "b": 4.0}])
    assert found == {"a": 1.5, "b": None}
    assert goal("unknown", None, 1.0)["reached"] is None
    assert goal("high", 2.0, 1.0, at_most=False)["reached"] is True


def test_cells_have_intervals_of_several_seeds_units_and_a_dash_without_a_figure():
    one = {"of": {"share": 0.5, "length": 3.0, "lacking": None}}
    several = {**one, "half_width": {"of": {"share": 0.02, "length": 0.5, "lacking": None}}}
    assert runner.cell(one, ["of", "share"], ".1%") == "50.0 %"
    assert runner.cell(several, ["of", "share"], ".1%") == "50.0 ± 2.0 %"
    assert runner.cell(several, ["of", "length"], ".1f", "m") == "3.0 ± 0.5 m"
    assert runner.cell(several, ["of", "lacking"], ".1f", "m") == "-"
    assert runner.cell({"of": {}}, ["of", "scores", "length"], ".1f") == "-"


def test_figures_and_goals_join_the_summary_and_replace_their_own(tmp_path):
    summary = {"p": 2, "cases": {"a": 1}, "goals": [{"name": "filter"}, {"name": "value"}]}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    assert runner.run(study(in_summary="own"), ["--out", str(tmp_path)]) == 0
    found = read(tmp_path, "summary")
    assert (found["p"], found["cases"]) == (2, {"a": 1})
    assert [each["name"] for each in found["goals"]] == ["filter", "value"]
    assert found["goals"][1]["value"] == 1.0
    assert found["own"] == {"seeds": [3], "of": {"value": 1.0}, "names": ["a"]}


def test_a_study_that_is_not_complete_writes_what_it_has_and_fails(tmp_path):
    given = ["--out", str(tmp_path)]
    assert runner.run(study(complete=lambda found: False), given) == 1
    assert read(tmp_path)["of"] == {"value": 1.0}


def test_a_study_that_cannot_be_done_gives_the_reason(tmp_path, capsys):
    def measure(arguments, seed):
        raise StudyError("no plots")

    assert runner.run(study(measure=measure), ["--out", str(tmp_path)]) == 1
    assert "drawn: no plots" in capsys.readouterr().out
    assert not (tmp_path / "drawn.json").exists()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--seed", "-1"), "drawn: --seed: -1 given, must be at least 0"),
        (("--runs", "0"), "drawn: --runs: 0 given, must be at least 1"),
        (("--minutes", "nan"), "drawn: --minutes: nan given, must be at least 3"),
    ],
)
def test_wrong_arguments_are_refused(arguments, reason, capsys):
    assert runner.run(study(least_minutes=3.0), arguments) == 2
    assert capsys.readouterr().err.startswith(reason)
