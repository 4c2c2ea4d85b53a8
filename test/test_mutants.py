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


def test_changes_of_a_mutant_are_its_lines(tmp_path):
    module = tmp_path / MUTANTS["CORE"] / "one.py"
    module.parent.mkdir(parents=True)
    bodies = {
        "orig": "a = 1\n    return a + b",
        "1": "a = 1\n    return a - b",
        "2": "a = None\n    return a + b",
    }
    module.write_text("".join(f"def x_f__mutmut_{k}(b):\n    {v}\n" for k, v in bodies.items()))
    status = {
        "phd_jdtc_ros.core.one.x_f__mutmut_1": "survived",
        "phd_jdtc_ros.core.one.x_f__mutmut_2": "no tests",
        "phd_jdtc_ros.core.one.x_f__mutmut_3": "killed",
        "phd_jdtc_ros.core.one.x_f__mutmut_4": "timeout",
    }
    result, used = MUTANTS["judged"](status, tmp_path, {("one.py", "- a = 1\n+ a = None")})
    assert (result.mutants, result.killed, result.equivalent) == (4, 2, 1)
    assert result.survivors == [
        "phd_jdtc_ros.core.one.x_f__mutmut_1: survived\n- return a + b\n+ return a - b"
    ]
    assert used == {("one.py", "- a = 1\n+ a = None")}
    assert result.share == pytest.approx(2 / 3)


def test_equivalent_mutants_are_of_modules_that_are_mutated():
    modules = {module for part in MUTANTS["PARTS"].values() for module in part.modules}
    assert {module for module, _ in MUTANTS["known_equivalents"]()} <= modules
