# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation's examples work, and its pages are all in the site."""

import re
from pathlib import Path

import pytest
import yaml

from phd_jdtc_ros.core.configuration.build import resolve
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


def launch_arguments(name):
    """Return the arguments that a launch file declares; some of the demo's are in a table."""
    text = (ROOT / "launch" / name).read_text()
    passed_on = re.search(r"^TRACKER_ARGUMENTS = \{(.*?)^\}", text, re.DOTALL | re.MULTILINE)
    return {
        *re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text),
        *re.findall(r'^    "(\w+)":', passed_on[1] if passed_on else "", re.MULTILINE),
    }


def test_readme_lists_the_arguments_of_the_launch_files():
    readme = (ROOT / "README.md").read_text()
    table = readme.split("| launch file | argument |")[1].split("\n\n")[0]
    listed = {
        word for row in table.splitlines()[2:] for word in re.findall(r"`(\w+)`", row.split("|")[2])
    }

    assert listed == launch_arguments("tracker.launch.py") | launch_arguments("demo.launch.py")


def test_launch_commands_in_the_text_use_arguments_that_there_are():
    used = [
        (name, argument)
        for page in [ROOT / "README.md", *PAGES, *(ROOT / "launch").glob("*.py")]
        for name, rest in re.findall(
            r"(\w+\.launch\.py)((?:[ \[]+\w+:=[^\s`]+)+)", page.read_text()
        )
        for argument in re.findall(r"(\w+):=", rest)
    ]

    assert len({name for name, _ in used}) == 2
    assert not [
        (name, argument) for name, argument in used if argument not in launch_arguments(name)
    ]


def test_navigation_is_yaml():
    assert yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]
