# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The shipped profiles resolve and run."""

from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.core.simulation import paper_scenario, simulate
from phd_jdtc_ros.tools import params_file

CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize("profile", ["paper_scenario", "paper_literal", "surveillance"])
def test_profile_runs_a_few_scans(profile):
    config = resolve(params_file.load(CONFIG / f"{profile}.yaml"))
    engine = config.engine()
    steps = [engine.step(s) for _, s in simulate(paper_scenario(config.model.radars), 0)[:8]]

    assert len(engine.flush()) == 5
    for step in steps:
        assert np.isfinite(step.filtered.state).all()
        assert np.isfinite(step.class_mass).all()


def test_paper_literal_has_what_the_paper_prints():
    values = resolve(params_file.load(CONFIG / "paper_literal.yaml")).values

    assert values["corrector"] == "poisson"
    assert values["death_term"] == "paper"
    assert values["extraction"] == "clusters"
    assert values["ct.turn_noise_density"] == 0.1
    assert sum(values[f"{name}.rates"][0] for name in values["births"]) == 0.02
    assert sum(values[f"{name}.rates"][1] for name in values["births"]) == 0.03


def test_surveillance_knows_no_birth_places():
    config = resolve(params_file.load(CONFIG / "surveillance.yaml"))

    assert config.model.births == ()
    assert config.model.detection_births.enabled
