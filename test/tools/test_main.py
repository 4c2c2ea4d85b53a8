"""The executables, what they print, and the shipped profiles that they run."""

import contextlib
import importlib.util
import itertools
import os
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros import __main__ as package
from phd_jdtc_ros.__main__ import EXECUTABLES
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate
from phd_jdtc_ros.threads import THREAD_VARIABLES
from phd_jdtc_ros.tools import compile_engines

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def start(monkeypatch, capsys):
    """Return a function that runs ``python -m phd_jdtc_ros``: status, output and errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["phd_jdtc_ros", *arguments])
        try:
            status = package.main()
        except SystemExit as end:  # Argparse says so
            status = end.code
        return status, *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["no_such_node"], "unknown executable 'no_such_node'\n"),
        (["no_such_node", "--help"], "unknown executable 'no_such_node'\n"),
        ([], ""),
        (["-h"], None),
        (["--help"], None),
    ],
)
def test_usage_is_printed_unless_an_executable_is_named(start, arguments, refusal):
    status, out, err = start(*arguments)
    assert status == (0 if refusal is None else 2)
    text, other = (out, err) if refusal is None else (err, out)
    assert other == ""
    assert text.startswith(f"{refusal or ''}usage: python -m phd_jdtc_ros NAME [ARGUMENTS]\n")
    for name in EXECUTABLES:
        assert f"\n  {name} " in text


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="a BLAS has one thread then")
def test_an_executable_computes_on_one_thread_unless_the_environment_has_another():
    script = """
        import os
        from phd_jdtc_ros.__main__ import track_bag
        try:
            track_bag(["--help"])
        except SystemExit:
            print(len(os.listdir("/proc/self/task")))
    """

    def threads(**settings):
        kept = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}
        command = [sys.executable, "-c", textwrap.dedent(script)]
        done = subprocess.run(
            command, env={**kept, **settings}, capture_output=True, text=True, check=True
        )
        return int(done.stdout.split()[-1])

    assert threads() < threads(OPENBLAS_NUM_THREADS="2", OMP_NUM_THREADS="2")


@pytest.mark.parametrize("name", ["simulate", "track_bag", "demo"])
def test_help_of_an_offline_executable_names_its_arguments(start, name):
    status, out, err = start(name, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(f"usage: {name} ")
    assert "--out" in out
    assert "NAME:=VALUE" in out
    assert "`" not in out  # Names of modules are for those who read the code


def test_an_executable_passes_its_status_on(tmp_path):
    done = subprocess.run(
        [
            *(sys.executable, "-m", "phd_jdtc_ros", "track_bag"),
            *(tmp_path / "none", "--out", tmp_path / "out"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"track_bag: {tmp_path / 'none'}: no such bag\n"


def test_the_engines_are_compiled_without_arguments(capsys):
    assert compile_engines.main([]) == OK
    said = capsys.readouterr().out
    assert "phd: ready after" in said
    assert "gaussian: ready after" in said
    with pytest.raises(SystemExit, match="2"):
        compile_engines.main(["everything"])
    assert "unrecognized arguments: everything" in capsys.readouterr().err


@pytest.mark.parametrize("name", itertools.chain(*compile_engines.PARTS))
def test_parts_that_another_process_compiles_in_silence_exist(name):
    assert importlib.util.find_spec(name) is not None


def test_without_numba_it_fails_and_says_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(compilation, "numba", None)
    assert compile_engines.main([]) == FAILED
    assert "numba is not installed: pip install numba" in capsys.readouterr().err


def test_a_result_that_is_not_stored_is_a_failure(monkeypatch, capsys):
    monkeypatch.setattr(compilation, "NOT_STORED", ["sums"])
    monkeypatch.setattr(compile_engines, "_compiling", contextlib.nullcontext)
    assert compile_engines.main([]) == FAILED
    assert "NUMBA_CACHE_DIR" in capsys.readouterr().err


@pytest.mark.parametrize(
    "profile", ["defaults", "reference", "paper_literal", "phd", "surveillance"]
)
def test_profile_runs_a_few_scans(profile):
    config = resolve(from_arguments.load(CONFIG / f"{profile}.yaml"))
    engine = new_engine(config)
    steps = [engine.step(s) for _, s in simulate(paper_scenario(config.model.radars), 0)[:8]]
    assert len(engine.flush()) == 5
    for step in steps:
        assert np.isfinite(step.filtered[0].state).all()
        assert np.isfinite(step.class_mass).all()


def test_automotive_tracks_its_bag_s_scenario():
    given = from_arguments.load(CONFIG / "automotive.yaml")
    document = yaml_files.load(CONFIG / "scenarios" / "automotive.yaml")
    config = resolve(given)
    scene = resolve(from_arguments.scenario_parameters(document))
    # The profile and the scenario agree on the radar's properties.
    (radar,) = config.model.radars
    # Learning begins with other clutter than the scenario has.
    (real,) = scene.model.radars
    assert replace(radar, clutter_rate=real.clutter_rate) == real
    tracker = new_engine(config)
    scenario = scenario_file.resolve(document, scene.model.radars)
    truth, scan = zip(*simulate(scenario, 2)[:5], strict=True)
    steps = [tracker.step(each) for each in scan]
    assert len(steps[-1].filtered[0]) == len(truth[-1].track_id)


@pytest.mark.parametrize(("profile", "name"), [("drone", "drones"), ("automotive_4d", "cars_4d")])
def test_profile_tracks_a_scenario_in_space(profile, name):
    given = from_arguments.load(CONFIG / f"{profile}.yaml")
    document = yaml_files.load(CONFIG / "scenarios" / f"{name}.yaml")
    config = resolve(given)
    scene = resolve(from_arguments.scenario_parameters(document))
    (radar,), (real,) = config.model.radars, scene.model.radars
    assert replace(radar, clutter_rate=real.clutter_rate) == real
    tracker = new_engine(config)
    scenario = scenario_file.resolve(document, scene.model.radars)
    truth, scan = zip(*simulate(scenario, 2)[:20], strict=True)
    steps = [tracker.step(each) for each in scan]
    found, true = steps[-1].filtered[0], truth[-1]
    assert len(found) == pytest.approx(len(true.track_id), abs=2)
    place = np.column_stack([true.position, true.height[:, 0]])
    own = np.column_stack([found.position, found.attributes.height[:, 0]])
    apart = np.linalg.norm(own[:, None] - place, axis=2).min(axis=1)
    assert np.median(apart) < 30.0


def test_profiles_of_the_paper_have_what_it_prints():
    values = resolve(from_arguments.load(CONFIG / "paper_literal.yaml")).values
    assert values["engine"] == "phd_as_printed"
    assert values["ct.turn_noise_density"] == 0.1
    assert sum(values[f"{name}.rates"][0] for name in values["births"]) == 0.02
    assert sum(values[f"{name}.rates"][1] for name in values["births"]) == 0.03


def test_the_papers_filter_has_its_motion_in_the_reference_scenario():
    phd, reference = (
        resolve(from_arguments.load(CONFIG / f"{name}.yaml")).values
        for name in ("phd", "reference")
    )
    assert {name for name in phd if phd[name] != reference[name]} == {
        "engine",
        "particles",
        "class_0.mode_transition",
        "class_1.mode_transition",
        "cv.noise_density",
        "ct.turn_noise_density",
    }
    assert phd["cv.noise_density"] == phd["ct.noise_density"] == 1.0
    assert phd["class_0.mode_transition"] == [0.8, 0.2, 0.2, 0.8]


def test_the_defaults_are_those_of_surveillance():
    values = resolve(from_arguments.load(CONFIG / "surveillance.yaml")).values
    # Its names of topics, frames and fields are the usual ones, written out.
    written = ("topic", "frame", "range", "azimuth", "amplitude", "azimuth_convention")
    usual = resolve({}).values
    differing = {name for name in values if values[name] != usual.get(name)}
    assert {name.rpartition(".")[2] for name in differing} == {*written}


def test_a_tracker_with_nothing_set_finds_targets_wherever_they_appear():
    config = resolve({})
    document = yaml_files.load(CONFIG / "scenarios" / "manoeuvring.yaml")
    scenario = scenario_file.resolve(document, config.model.radars)
    engine, found, there = new_engine(config), 0, 0
    for truth, scan in simulate(scenario, 5)[10:]:
        (estimates,) = engine.step(scan).filtered
        apart = estimates.position[:, None] - truth.state[:, [0, 2]]
        near = np.linalg.norm(apart, axis=2).min(axis=0, initial=np.inf) < 1000.0
        found, there = found + near.sum(), there + len(near)
    assert found > 0.85 * there
