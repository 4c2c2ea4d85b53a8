"""The shipped profiles resolve and run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize(
    ("profile", "given"),
    [
        ("defaults", {}),
        ("paper_scenario", {}),
        ("paper_literal", {}),
        ("phd", {}),
        ("surveillance", {}),
        ("surveillance", {"engine": "particles"}),
    ],
)
def test_profile_runs_a_few_scans(profile, given):
    config = resolve(from_arguments.load(CONFIG / f"{profile}.yaml") | given)
    engine = new_engine(config)
    steps = [engine.step(s) for _, s in simulate(paper_scenario(config.model.radars), 0)[:8]]
    assert len(engine.flush()) == 5
    for step in steps:
        assert np.isfinite(step.filtered[0].state).all()
        assert np.isfinite(step.class_mass).all()


@pytest.mark.parametrize("engine", ["gaussian", "particles"])
def test_automotive_tracks_its_bag_s_scenario(engine):
    given = from_arguments.load(CONFIG / "automotive.yaml")
    document = yaml_files.load(CONFIG / "scenarios" / "automotive.yaml")
    config = resolve(given | {"engine": engine})
    scene = resolve(from_arguments.scenario_parameters(document))
    # The profile and the scenario agree on the radar's properties.
    (radar,) = config.model.radars
    assert replace(radar, detection_factor=None, noise_factor=None) == scene.model.radars[0]
    tracker = new_engine(config)
    scenario = scenario_file.resolve(document, config.model.radars)
    truth, scan = zip(*simulate(scenario, 2)[:5], strict=True)
    steps = [tracker.step(each) for each in scan]
    assert len(steps[-1].filtered[0]) == len(truth[-1].track_id)


def test_profiles_of_the_paper_have_what_it_prints():
    values = resolve(from_arguments.load(CONFIG / "paper_literal.yaml")).values
    assert values["engine"] == "phd_as_printed"
    assert values["ct.turn_noise_density"] == 0.1
    assert sum(values[f"{name}.rates"][0] for name in values["births"]) == 0.02
    assert sum(values[f"{name}.rates"][1] for name in values["births"]) == 0.03
    phd, paper = (
        resolve(from_arguments.load(CONFIG / f"{name}.yaml")).values
        for name in ("phd", "paper_scenario")
    )
    assert {name for name in phd if phd[name] != paper[name]} == {"engine"}


def test_paper_scenario_has_the_motion_of_the_paper():
    values = resolve(from_arguments.load(CONFIG / "paper_scenario.yaml")).values
    default = resolve({}).values
    changed = {name for name in values if values[name] != default[name]}
    assert changed == {
        "engine",
        "particles_per_target",
        "class_0.mode_transition",
        "class_1.mode_transition",
        "cv.noise_density",
        "ct.turn_noise_density",
    }
    assert values["cv.noise_density"] == values["ct.noise_density"] == 1.0
    assert values["class_0.mode_transition"] == [0.8, 0.2, 0.2, 0.8]


def test_surveillance_has_no_birth_places():
    config = resolve(from_arguments.load(CONFIG / "surveillance.yaml"))
    assert config.model.births == ()
    assert config.model.detection_births.enabled
