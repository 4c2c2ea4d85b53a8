import ast
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MUTANTS = runpy.run_path(str(ROOT / "test" / "mutants.py"), run_name="mutants")


@pytest.mark.parametrize("part", MUTANTS["PARTS"].values(), ids=MUTANTS["PARTS"])
def test_modules_and_tests_of_a_part_exist(part):
    core = ROOT / MUTANTS["CORE"]
    assert [module for module in part.modules if not (core / module).is_file()] == []
    assert [name for name in part.tests if not (ROOT / "test" / "core" / name).exists()] == []


def test_listed_equivalents_are_separated_from_survivors(tmp_path):
    module = tmp_path / MUTANTS["CORE"] / "one.py"
    module.parent.mkdir(parents=True)
    bodies = {"orig": "a = 1; return a + b", "1": "a = 1; return a - b", "2": "a = 2; return a + b"}
    module.write_text("".join(f"def x_f__mutmut_{k}(b): {v}\n" for k, v in bodies.items()))
    status = {
        f"phd_jdtc_ros.core.one.x_f__mutmut_{k}": what
        for k, what in enumerate(("survived", "no tests", "killed", "timeout"), start=1)
    }
    result = MUTANTS["judged"](status, tmp_path, {("one.py", "- a = 1\n+ a = 2")})
    assert (result.mutants, result.killed, result.equivalent) == (4, 2, 1)
    assert result.share == pytest.approx(2 / 3)


def test_equivalent_mutants_are_of_mutated_modules_and_their_lines():
    modules = {module for part in MUTANTS["PARTS"].values() for module in part.modules}
    assert {module for module, _ in MUTANTS["known_equivalents"]()} <= modules
    for module, change in MUTANTS["known_equivalents"]():
        source = ast.unparse(ast.parse((ROOT / MUTANTS["CORE"] / module).read_text()))
        line = change.removeprefix("- ").partition("\n+ ")[0]
        assert line in source, (module, line)


def test_some_changes_are_equivalent_anywhere():
    equivalent = MUTANTS["equivalent_anywhere"]
    line = "a, b = c.reshape(-1, 2), d.reshape(-1)"
    assert equivalent(f"- {line}\n+ a, b = c.reshape(-1, 2), d.reshape(-2)")
    assert not equivalent(f"- {line}\n+ a, b = c.reshape(-1, 3), d.reshape(-1)")
