"""Functions that numba compiles do the same where it is missing."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import dome
import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.core.arrays import frozen
from phd_jdtc_ros.core.state_space import PLANAR, SPATIAL

ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys, json
if {hidden}: sys.modules["numba"] = None
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
config = resolve({{"lag": 2}})
engine, found = new_engine(config), []
for _, scan in simulate(paper_scenario(config.model.radars), 1):
    step = engine.step(scan)
    found += [one.state.tolist() for one in (*step.filtered, *step.smoothed)]
    if len(found) > 20:
        break
print(json.dumps([compilation.numba is None, found]))
"""


def estimates(hidden):
    """Return what a new interpreter prints: whether numba is missing, the states, and warnings."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(hidden=hidden)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout), done.stderr


def test_estimates_are_the_same_without_numba():
    pytest.importorskip("numba", reason="both ways are the same without it")
    (missing, plain), warning = estimates(True)
    (found, compiled), silence = estimates(False)
    assert "pip install numba" in warning
    assert not silence
    assert missing
    assert not found
    assert sum(map(len, plain)) > 40
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_functions_are_interpreted_where_numba_is_switched_off():
    script = (
        "from phd_jdtc_ros.core.association import marginals\n"
        "print(type(marginals.edge_probabilities).__name__)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "function"


def test_name_of_compiled_code_changes_with_the_functions_that_it_calls(tmp_path, monkeypatch):
    pytest.importorskip("numba", reason="nothing is stored without it")
    monkeypatch.syspath_prepend(tmp_path)
    called = "from phd_jdtc_ros.core.compilation import inner\n@inner\ndef one(x): return {value}\n"
    (tmp_path / "of_two.py").write_text(
        "from of_one import one\nfrom phd_jdtc_ros.core.compilation import compiled\n"
        "@compiled\ndef two(x: float): return 2.0 * one(x)\n"
    )
    names = []
    for value in ("x", "x + 1.0"):
        (tmp_path / "of_one.py").write_text(called.format(value=value))
        for module in ("of_one", "of_two"):
            sys.modules.pop(module, None)
        import of_two

        names.append(of_two.two.py_func.__qualname__)
        assert of_two.two(3.0) == 2.0 * eval(value, {"x": 3.0})
    assert len(set(names)) == 2


def test_signature_gives_the_axes_of_arrays_that_may_be_read_only():
    numba = pytest.importorskip("numba", reason="signatures are numba's")

    @compilation.compiled
    def total(table: compilation.Float2, row: compilation.Int1) -> float:
        return table[row[0]].sum()

    table = np.ones((2, 3))
    table.flags.writeable = False
    assert total(table, np.array([1])) == 3.0
    with pytest.raises(TypeError):
        total(np.ones(3), np.array([1]))
    assert total.signatures[0][0] == numba.types.Array(numba.float64, 2, "C", readonly=True)


class Table(NamedTuple):
    """A table and the row to sum."""

    values: compilation.Float2
    row: int


def test_named_tuples_are_read_only_unless_they_are_declared_writeable():
    pytest.importorskip("numba", reason="signatures are numba's")

    @compilation.compiled
    def total(table: Table) -> float:
        return table.values[table.row].sum()

    @compilation.compiled
    def clear(table: compilation.Writeable[Table]) -> None:
        table.values[table.row] = 0.0

    table = Table(np.ones((2, 3)), 1)
    with pytest.raises(TypeError):
        total(table)
    clear(table)
    assert total(frozen(table)) == 0.0
    assert table.values[0].sum() == 3.0
    with pytest.raises(TypeError):
        clear(table)


def test_name_of_compiled_code_changes_with_the_named_tuples_that_it_takes(tmp_path, monkeypatch):
    pytest.importorskip("numba", reason="nothing is stored without it")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "of_first.py").write_text(
        "from of_ends import Ends\nfrom phd_jdtc_ros.core.compilation import compiled\n"
        "@compiled\ndef first(ends: Ends): return ends.first\n"
    )
    # The second text is written within the second and as long as the first.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    names = []
    for fields in ("first: float; last: float", "last: float; first: float"):
        text = f"from typing import NamedTuple\nclass Ends(NamedTuple): {fields}\n"
        (tmp_path / "of_ends.py").write_text(text)
        for module in ("of_ends", "of_first"):
            sys.modules.pop(module, None)
        from of_ends import Ends
        from of_first import first

        names.append(first.py_func.__qualname__)
        assert first(Ends(first=1.0, last=2.0)) == 1.0
    assert len(set(names)) == 2


def test_interruption_that_numba_swallows_ends_the_compilation(monkeypatch):
    numba = pytest.importorskip("numba", reason="nothing is compiled without it")
    compile_with = numba.njit

    def njit(*signature, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return compile_with(*signature, **options)

    def twice(x: float) -> float:
        return 2.0 * x

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        monkeypatch.setattr(numba, "njit", njit)
        with pytest.raises(KeyboardInterrupt):
            compilation.compiled(twice)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


SIZE = compilation.SIZE


@compilation.inner
def _share(value):
    return value / SIZE


@compilation.BySize
@compilation.compiled
def _shared(value: float) -> tuple[float, int]:
    return _share(value), SIZE


def test_functions_of_another_size_have_it_in_what_they_call_too():
    assert len(PLANAR) == SIZE
    assert _shared[SIZE](35.0) == (7.0, SIZE)
    assert _shared[7](35.0) == (5.0, 7)
    assert _shared[7] is _shared[7]
    assert _shared[SIZE](35.0) == (7.0, SIZE)


def test_an_engine_in_space_has_compiled_its_functions_before_the_first_scan():
    for function in compilation.BySize.made:
        function.pop(len(SPATIAL), None)
    new_engine(lone(dome.SPACE))
    assert all(len(SPATIAL) in function for function in compilation.BySize.made)
