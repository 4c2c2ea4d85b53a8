"""The documentation's examples work, and its pages are all in the site."""

import re
from pathlib import Path

import pytest
import yaml

from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.tools import params_file

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EXAMPLES = [
    (f"{page.relative_to(ROOT)}:{page.read_text()[: match.start()].count(chr(10)) + 1}", match[1])
    for page in [ROOT / "README.md", *PAGES]
    for match in re.finditer(r"^```ya?ml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
]


def test_the_radar_page_has_its_examples():
    names = [name for name, _ in EXAMPLES]
    assert sum(name.startswith("docs/connect_your_radar.md") for name in names) == 3


@pytest.mark.parametrize(("name", "text"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_every_example_is_a_parameter_file_that_resolves(tmp_path, name, text):
    path = tmp_path / "example.yaml"
    path.write_text(text)

    assert resolve(params_file.load(path)).inputs


def test_every_page_is_in_the_sites_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text()
    listed = {ROOT / "docs" / name for name in re.findall(r"[\w/]+\.md", navigation)}

    assert {*PAGES} == listed


@pytest.mark.parametrize("name", ["tracker", "sensor_replay", "evaluator"])
def test_a_nodes_page_has_the_usual_sections(name):
    text = (ROOT / "docs" / "nodes" / f"{name}.md").read_text()

    assert re.findall(r"^## (.+)$", text, re.MULTILINE) == [
        "Purpose",
        "Inner workings",
        "Inputs and outputs",
        "Parameters",
        "Known limits",
        "Performance",
    ]


def test_navigation_is_yaml():
    assert yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]
