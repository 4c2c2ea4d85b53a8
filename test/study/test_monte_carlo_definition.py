import json
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import faults_of

import studies
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.study import definition
from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.study.definition import KINDS, Kind, merge_layers
from phd_jdtc_ros.study.document import resolve
from phd_jdtc_ros.tools.monte_carlo import load_study
from studies import peers

ROOT = Path(__file__).parents[2]
ONE_CLASS = {
    "classes": ["only"],
    "only.motions": ["cv"],
    "only.mode_transition": [1.0],
    **{f"start_{k}.rates": [0.01] for k in range(1, 5)},
}
# The variants of the study that name an engine, and the engines.
PHD_VARIANTS = {"corrected": "phd", "as printed": "phd_as_printed", "fewer": "phd"}
SOURCES = Path(studies.__file__).parents[1]


def faults(study_file, change, assigned=None):
    return faults_of(load_study, study_file(change), assigned or {})


@pytest.fixture(scope="module")
def published():
    return load_study(ROOT / "config" / "studies" / "published.yaml", {})


def test_resolve_finds_every_published_goal_among_what_is_run(published):
    """A goal of a variant, case or lag that is not run would never be checked."""
    assert {variant.kind for variant in published.variants} == set(KINDS.values())
    variants = {variant.name: variant for variant in published.variants}
    cases = {case.name: case for case in published.cases}
    for goal in published.goals:
        others = (goal.relative_to or goal.variant, goal.relative_case)
        for name, case in ((goal.variant, goal.case), others):
            assert case in variants[name].cases
            assert goal.lag in cases[case].lags_of(variants[name])


def test_a_case_has_a_cutoff_of_its_own_and_only_the_variants_that_name_it(study_file):
    def change(document):
        near = {**document["cases"]["quiet"], "cutoff": 20.0, "only_named": True}
        document["cases"]["near"] = near
        document["variants"]["named"] = {"kind": "gaussian", "cases": ["near"]}

    study = load_study(study_file(change), {})
    assert [study.cutoff_of(case) for case in study.cases] == [1000.0, 20.0]
    assert {v.name: v.cases for v in study.variants if "near" in v.cases} == {"named": ("near",)}
    tasks = study_tasks.plan(study, [0]).tasks
    assert {task.case: task.cutoff for task in tasks} == {"quiet": 1000.0, "near": 20.0}


def test_case_may_define_the_replies_of_its_targets(study_file):
    def change(document):
        document["cases"]["quiet"]["transponders"] = {"share": 0.5, "seed": 3}

    study = load_study(study_file(change), {})
    given = study.cases[0].scenario.transponders
    assert (given.share, given.seed) == (0.5, 3)


def test_resolve_lists_every_fault(study_file):
    def spoil(document):
        document["lags"] = [0, -1]
        document["colour"] = "red"
        document["cases"]["quiet"]["parameters"]["radar_1.clutter_rate"] = -3.0
        document["cases"]["nowhere"] = {"scenario": "absent.yaml"}
        document["cases"]["nothing"] = {}
        document["variants"]["wrong"] = {"kind": "theirs", "cases": ["loud"], "size": 1}
        document["variants"]["reference"]["parameters"] = {}
        document["variants"]["corrected"] |= {"run_share": "none", "lags": "all"}
        document["variants"]["as printed"]["parameters"] = {"lag": 3}
        document["goals"][0] |= {"figure": "beauty", "at_least": 1.0}

    found = faults(study_file, spoil)

    assert sorted(fault.split(": ")[0] for fault in found) == [
        "cases.nothing.scenario",
        "cases.nowhere.scenario",
        "cases.quiet.parameters.radar_1.clutter_rate",
        "colour",
        "goals[0].at_most",
        "goals[0].figure",
        "lags",
        "variants.as printed.parameters.lag",
        "variants.corrected.lags",
        "variants.corrected.run_share",
        "variants.reference.parameters",
        "variants.wrong.cases",
        "variants.wrong.kind",
        "variants.wrong.size",
    ]


def test_variants_have_those_of_their_lags_that_the_case_has(study_file):
    def given(lags):
        def change(document):
            document["cases"]["quiet"]["lags"] = lags

        return change

    study = load_study(study_file(given([0])), {})
    tasks = study_tasks.plan(study, [0]).tasks
    found = {v.name: v.lags for task in tasks if task.case == "quiet" for v in task.variants}
    assert set(found.values()) == {(0,)}

    wrong = faults(study_file, given([1]))
    # One variant has it, the others do not.
    assert "cases.quiet.lags: [1] given, corrected has none of them" in wrong
    assert not any("fewer" in fault for fault in wrong)


@pytest.mark.parametrize(
    ("changed", "value", "expected"),
    [
        ("cases.quiet.cutoff", 0.0, ["cutoff: 0.0 given, must be "]),
        ("cases.quiet.only_named", "yes", ["only_named: 'yes' given, must be "]),
        ("cases.quiet.transponders", {"share": 2.0}, ["transponders.share: 2.0 given"]),
        ("cases.quiet.parameters", ONE_CLASS, ["scenario: class 1 of a target, must be below 1"]),
        (
            "variants.fewer.parameters",
            {"particles": [-1], "nonsense": 1},
            ["parameters.particles: ", "parameters.nonsense: "],
        ),
        ("variants.corrected.engine", "steam", ["engine: "]),
        ("variants.reference.engine", "gaussian", ["engine: "]),
    ],
)
def test_resolve_names_what_is_wrong_in_a_case_or_a_variant(study_file, changed, value, expected):
    part, name, key = changed.split(".")
    found = faults(study_file, lambda document: document[part][name].update({key: value}))
    assert len(found) == len(expected)
    for fault, words in zip(found, expected, strict=True):
        assert fault.startswith(f"{part}.{name}.{words}")


@pytest.mark.parametrize("share", [0, -0.5, 1.5, "half", True])
@pytest.mark.parametrize(("part", "name"), [("cases", "quiet"), ("variants", "reference")])
def test_resolve_refuses_a_share_of_the_runs_that_is_none(part, name, share, study_file):
    def change(document):
        document[part][name]["run_share"] = share

    fault = f"{part}.{name}.run_share: {share!r} given, must be above 0 and at most 1"
    assert faults(study_file, change) == [fault]


def test_resolve_names_faults_of_the_command_line_and_keeps_the_data(study_file):
    found = faults(study_file, lambda _: None, {"nonsense": 1, "seed": 3})

    assert [fault.split(": ")[0] for fault in found] == ["-p seed", "-p nonsense"]

    def change(document):
        document["variants"]["fewer"]["parameters"] = {"radar_1.clutter_rate": 9.0}

    plan = study_tasks.plan(load_study(study_file(change), {}), [0])

    assert {task.scenario.radars[0].clutter_rate for task in plan.tasks} == {3.0}


@pytest.mark.parametrize("document", [None, [], "study"])
def test_resolve_refuses_what_is_no_mapping(document):
    with pytest.raises(ConfigError, match="study: must be a mapping"):
        resolve(document, None, {})


@pytest.mark.parametrize("key", ["lags", "cases", "variants"])
def test_resolve_refuses_a_study_without_a_part(study_file, key):
    found = faults(study_file, lambda document: document.pop(key))
    assert any(fault.startswith(f"{key}: ") for fault in found)


def test_resolve_merges_scenario_case_variant_and_command_line(study_file):
    def change(document):
        document["cases"]["quiet"]["parameters"]["particles"] = [80]

    study = load_study(study_file(change), {"spawn.rate": 0.02})
    (case,) = study.cases
    corrected, _, fewer, _ = (study.parameters(case, variant) for variant in study.variants)

    assert corrected["radar_1.clutter_rate"] == corrected["radar_2.clutter_rate"] == 3.0
    assert (corrected["particles"], fewer["particles"]) == ([80], [50])
    assert corrected["spawn.rate"] == fewer["spawn.rate"] == 0.02


def test_merged_forgets_parts_that_a_later_layer_leaves_out():
    found = merge_layers(
        {"births": ["east", "west"], "east.rates": [1.0], "west.rates": [2.0], "lag": 3},
        {"births": ["west"]},
    )
    assert found == {"births": ["west"], "west.rates": [2.0], "lag": 3}
    known = {"births": ["gate"], "gate.rates": [1.0]}
    assert merge_layers(known, {"births": []}) == {"births": []}


def test_merged_gives_every_class_what_is_given_for_all():
    found = merge_layers(
        {"classes": ["ship", "boat"], "ship.survival_probability": 0.9},
        {"*.survival_probability": 0.8, "boat.survival_probability": 0.7},
    )
    assert found == {
        "classes": ["ship", "boat"],
        "ship.survival_probability": 0.8,
        "boat.survival_probability": 0.7,
    }
    of_default_classes = merge_layers({"*.motions": ["cv"]})
    assert of_default_classes == {"class_0.motions": ["cv"], "class_1.motions": ["cv"]}


def kinds_of(study_file, change, assigned=None):
    study = load_study(study_file(change), assigned or {})
    return {
        variant.name: (variant.kind.name, study.parameters(study.cases[0], variant).get("engine"))
        for variant in study.variants
    }


@pytest.mark.parametrize(
    "given",
    [
        {"kind": "gaussian"},
        {"engine": "gaussian"},
        {"kind": "phd", "engine": "gaussian"},
        {"kind": "phd", "parameters": {"engine": "gaussian"}},
    ],
)
def test_a_variant_of_the_tracker_names_its_engine(study_file, given):
    def change(document):
        document["variants"]["other"] = given

    kinds = kinds_of(study_file, change)
    assert kinds["other"] == ("gaussian", "gaussian")
    assert kinds["corrected"] == ("phd", "phd")


def test_an_engine_on_the_command_line_leaves_out_the_variants_of_others(study_file):
    def change(document):
        document["variants"]["own"] = {"kind": "gaussian"}

    plan = study_tasks.plan(load_study(study_file(change), {"engine": "gaussian"}), [0])
    assert plan.notes == [
        f"{name}: left out, engine: {engine} given, must be gaussian with engine gaussian"
        for name, engine in PHD_VARIANTS.items()
    ]
    assert {variant.name for task in plan.tasks for variant in task.variants} == {
        "own",
        "reference",
    }


def test_variants_that_are_left_out_are_not_checked_with_parameters_of_the_assigned_engine(
    study_file,
):
    learned = {"radar_1.clutter_amplitude": "learned"}
    assert faults(study_file, lambda _: None, learned) == [
        f"variants.{name}.parameters.radar_1.clutter_amplitude: learned given, must be rayleigh "
        f"with engine {engine}"
        for name, engine in PHD_VARIANTS.items()
    ]
    study = load_study(study_file(), {"engine": "gaussian", **learned})
    assert list(study.left_out) == list(PHD_VARIANTS)


def test_select_lists_every_unknown_name(study):
    with pytest.raises(ConfigError) as caught:
        study.select(["loud"], ["corrected", "best"])
    assert [fault.split(" given")[0] for fault in caught.value.faults] == [
        "--case: 'loud'",
        "--variant: 'best'",
    ]


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("phd", "core/phd/particle_filter.py"),
        ("gaussian", "study/tracker.py"),
        ("gaussian", "core/gaussian/update.py"),
        ("gaussian", "study/tasks.py"),
        ("reference", "study/reference.py"),
        ("gnn_loud", "study/tasks.py"),
        ("turning", "study/tracker.py"),
    ],
)
def test_sources_have_what_the_scores_depend_on(kind, path):
    assert SOURCES / "phd_jdtc_ros" / path in peers.KINDS[kind].sources()


def test_peers_have_sources_of_their_own_in_the_repository():
    own = {SOURCES / "studies" / "peers" / name for name in ("settings.py", "__init__.py")}
    assert own <= set(peers.KINDS["gnn_loud"].sources())
    assert not own & set(peers.KINDS["gaussian"].sources())
    assert "python -m studies monte_carlo" in definition.KINDS["gnn"].missing()
    assert definition.KINDS["gaussian"].missing() is None


def test_code_follows_the_sources_of_a_kind(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_tracker.py").write_text("GATE = 3.0\n")
    kind = Kind("own", lambda *_: None, modules=("own_tracker",))
    before = definition.code_of.__wrapped__(kind)
    (tmp_path / "own_tracker.py").write_text("GATE = 4.0\n")
    assert definition.code_of.__wrapped__(kind) != before


def test_sources_have_every_module_that_the_kinds_import():
    script = (
        "import json, sys, studies.peers; "
        "print(json.dumps([m.__file__ for n, m in sys.modules.items() if n.partition('.')[0] in "
        "('phd_jdtc_ros', 'studies') and not n.endswith(('_ros', 'studies', '.study'))]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=SOURCES, capture_output=True, check=True
    )
    # How a study is defined and written does not change its scores.
    of_study = SOURCES / "phd_jdtc_ros" / "study"
    others = {of_study / f"{name}.py" for name in ("definition", "metrics")}
    found = {*map(Path, json.loads(done.stdout))} - others
    assert found <= {*peers.KINDS["gnn"].sources(), SOURCES / "phd_jdtc_ros" / "output_files.py"}
