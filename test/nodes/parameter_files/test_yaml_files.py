import itertools
import math
import time
from pathlib import Path

import pytest
from refusals import faults_of

from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.parameter_files import sections, yaml_files
from robustness.hostile_input.bombs import YAML as BOMBS

ROOT = Path(__file__).parents[3]
NODES = ("tracker", "evaluator", "sensor_replay")
LIMIT_S = 2.0


def fault(text):
    (only,) = faults_of(yaml_files.parse, text, "it")
    return only


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6),
        ("1e9", 1e9),
        ("-1.5E+3", -1500.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("7", 7),
        ("0x1F", 31),
        ("010", 8),
        ("08", 8.0),
        (".inf", math.inf),
        ("-.inf", -math.inf),
        ("y", True),
        ("off", False),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("2026-01-02", "2026-01-02"),
        ("'1e9'", "1e9"),
        ("~", None),
        ("", None),
    ],
)
def test_scalars_are_those_of_ros(text, value):
    found = yaml_files.parse(text, "it")
    assert found == value
    assert type(found) is type(value)


def test_keys_are_names_given_once_and_lists_may_be_tuples():
    text = "{a: &a {x: 1e-6, y: 2}, b: {<<: *a, 1: z}}"
    assert yaml_files.parse(text, "it")["b"] == {"x": 1e-6, "y": 2, "1": "z"}
    assert yaml_files.parse("topics: !!python/tuple\n- a\n- b\n", "it") == {"topics": ["a", "b"]}
    text = "tracker:\n  ros__parameters:\n    lag: 3\n    seed: 1\n    lag: 4\n"
    assert fault(text) == "it: line 5: lag is given twice, first in line 3"


@pytest.mark.parametrize("text", ["!!int x", "!!bool x", "!!float x", "!!timestamp x", "!!set {a}"])
def test_tags_that_do_not_fit_are_refused(text):
    assert fault(text).startswith("it: ")


def test_parameter_given_twice_in_both_notations_is_named(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("tracker: {ros__parameters: {a.b: 1, a: {b: 2}}}")
    with pytest.raises(ConfigError, match=r"p\.yaml: /tracker: a\.b is given twice"):
        sections.read(path)


@pytest.mark.parametrize("path", sorted(ROOT.glob("config/**/*.yaml")), ids=lambda path: path.stem)
def test_shipped_files_have_no_key_twice(path):
    assert yaml_files.load(path)


@pytest.mark.parametrize("name", BOMBS)
def test_bomb_is_refused_in_a_short_line_and_time(tmp_path, name):
    path = tmp_path / "bomb.yaml"
    path.write_text(BOMBS[name])
    begin = time.process_time()
    (only,) = faults_of(yaml_files.load, path)
    assert time.process_time() - begin < LIMIT_S
    assert only.startswith(f"{path}: ")
    assert len(only) < 400 + len(str(path))


@pytest.mark.parametrize("name", BOMBS)
def test_bomb_ends_every_offline_tool(tmp_path, capsys, name):
    path, out = tmp_path / "bomb.yaml", tmp_path / "out"
    path.write_text(BOMBS[name])
    for tool, words in (
        ("track_bag", [tmp_path, "--params-file", path, "--out", out]),
        ("simulate", ["--scenario", path, "--out", out]),
        ("monte_carlo", ["--study", path, "--out", out]),
    ):
        begin = time.process_time()
        assert run(tool, [*map(str, words)]) == 2
        assert time.process_time() - begin < 2 * LIMIT_S  # It includes the tool's import
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(("name", "bomb"), [*zip(itertools.cycle(NODES), BOMBS, strict=False)])
def test_bomb_ends_every_node(processes, tmp_path, name, bomb):
    path = tmp_path / "bomb.yaml"
    path.write_text(BOMBS[bomb])
    status, text = processes.run(name, "--ros-args", "--params-file", path)
    assert status == 2
    assert text.startswith(f"{name}: {path}: ")
    assert len(text.splitlines()) == 1
