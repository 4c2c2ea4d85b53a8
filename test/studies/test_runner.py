"""The runner of studies: seeds, goals, files and exit statuses."""

import json

import pytest

from studies import runner
from studies.runner import Study, StudyError, goal

DRAWN = {3: 1.0, 4: 3.0}


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
