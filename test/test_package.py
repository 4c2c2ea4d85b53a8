"""The package as a whole: versions, files and texts agree with each other."""

import ast
import re

import yaml
from manifest import MANIFEST, ROOT, SETUP

import phd_jdtc_ros
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import paper_scenario


def test_manifest_setup_and_citation_are_of_the_same_package():
    given = {name: MANIFEST.findtext(name) for name in ("version", "license", "maintainer")}
    given["maintainer_email"] = MANIFEST.find("maintainer").get("email")
    given["description"] = " ".join(MANIFEST.findtext("description").split())
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    changes = (ROOT / "CHANGELOG.rst").read_text()
    assert {name: ast.literal_eval(SETUP[name]) for name in given} == given
    assert given["version"] == citation["version"] == phd_jdtc_ros.__version__
    assert given["license"] == citation["license"] == "Apache-2.0"
    maintainers = {element.text for element in MANIFEST.findall("maintainer")}
    assert {author["name"] for author in citation["authors"]} <= maintainers
    released = f"{citation['version']} ({citation['date-released']})"
    assert re.search(rf"^{re.escape(released)}", changes, re.MULTILINE)


def test_shipped_defaults_and_reference_scenario_are_the_built_in_ones():
    written = from_arguments.load(ROOT / "config" / "defaults.yaml")
    assert written == resolve({}).values
    radars = resolve({}).model.radars
    document = yaml_files.load(ROOT / "config" / "scenarios" / "paper_scenario.yaml")
    assert scenario_file.resolve(document, radars) == paper_scenario(radars)


def test_one_file_states_the_licence_of_all():
    # REUSE 3.3 allows this file in the place of a header in every file.
    said = (ROOT / "REUSE.toml").read_text()
    assert re.findall(r'^path = "(.+)"$', said, re.MULTILINE)[0] == "**"
    used = re.findall(r'^SPDX-License-Identifier = "(.+)"$', said, re.MULTILINE)
    assert used[0] == MANIFEST.findtext("license")
    assert {f"{name}.txt" for name in used} == {f.name for f in (ROOT / "LICENSES").iterdir()}
