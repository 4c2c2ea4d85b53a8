"""The package as a whole: versions, files and texts agree with each other."""

import ast
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

import phd_jdtc_ros
from phd_jdtc_ros.__main__ import EXECUTABLES
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import from_arguments, yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import paper_scenario

ROOT = Path(__file__).parents[1]


def setup_arguments():
    tree = ast.parse((ROOT / "setup.py").read_text())
    call = next(
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"
    )
    return {keyword.arg: keyword.value for keyword in call.keywords}


def test_versions_are_equal():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    changes = (ROOT / "CHANGELOG.rst").read_text()
    version = phd_jdtc_ros.__version__

    assert manifest.findtext("version") == version
    assert ast.literal_eval(setup_arguments()["version"]) == version
    assert re.search(rf"^{re.escape(version)} ", changes, re.MULTILINE)


def test_maintainers_and_licence_are_equal():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    arguments = setup_arguments()

    assert ast.literal_eval(arguments["maintainer"]) == manifest.findtext("maintainer")
    assert ast.literal_eval(arguments["maintainer_email"]) == manifest.find("maintainer").get(
        "email"
    )
    assert ast.literal_eval(arguments["license"]) == manifest.findtext("license") == "Apache-2.0"


def test_descriptions_are_equal():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    described = " ".join(manifest.findtext("description").split())
    assert described == ast.literal_eval(setup_arguments()["description"])


@pytest.mark.parametrize(
    "name", ["README.md", "docs/index.md", "docs/method.md", "package.xml", "CITATION.cff"]
)
def test_filter_is_called_labelled_multi_bernoulli_with_soft_association(name):
    text = " ".join((ROOT / name).read_text().split())
    assert "labelled multi-Bernoulli filter" in text
    assert "soft association" in text


def test_every_message_package_is_declared():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in manifest if "depend" in element.tag}
    used = set()
    for folder in ("phd_jdtc_ros", "msg_adapters"):
        for path in (ROOT / folder).rglob("*.py"):
            used |= set(re.findall(r"^from (\w+)\.(?:msg|srv) import", path.read_text(), re.M))

    assert used <= declared


@pytest.mark.parametrize("name", EXECUTABLES)
def test_every_executable_is_installed(name):
    assert f'"{name}"' in (ROOT / "setup.py").read_text()


def test_file_of_defaults_has_all_of_them():
    written = from_arguments.load(ROOT / "config" / "defaults.yaml")
    defaults = resolve({}).values

    assert written == defaults


def test_reference_scenario_file_is_the_built_in_one():
    radars = resolve({}).model.radars
    document = yaml_files.load(ROOT / "config" / "scenarios" / "paper_scenario.yaml")

    assert scenario_file.resolve(document, radars) == paper_scenario(radars)


def test_one_file_states_the_licence_of_all():
    # REUSE 3.3 allows this file in the place of a header in every file.
    said = (ROOT / "REUSE.toml").read_text()
    licence = ElementTree.parse(ROOT / "package.xml").getroot().findtext("license")

    assert re.findall(r'^path = "(.+)"$', said, re.MULTILINE)[0] == "**"
    used = re.findall(r'^SPDX-License-Identifier = "(.+)"$', said, re.MULTILINE)
    assert used[0] == licence
    assert {f"{name}.txt" for name in used} == {f.name for f in (ROOT / "LICENSES").iterdir()}
