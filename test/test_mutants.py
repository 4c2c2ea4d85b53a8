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


def test_equivalent_mutants_are_of_mutated_modules_and_their_lines():
    modules = {module for part in MUTANTS["PARTS"].values() for module in part.modules}
    assert {module for module, _ in MUTANTS["known_equivalents"]()} <= modules
    for module, change in MUTANTS["known_equivalents"]():
        source = ast.unparse(ast.parse((ROOT / MUTANTS["CORE"] / module).read_text()))
        line = change.removeprefix("- ").partition("\n+ ")[0]
        assert line in source, (module, line)
