"""The documentation's examples work."""

import ast
import csv
import re
from pathlib import Path

import crossing
import numpy as np
import pytest
import yaml

from phd_jdtc_ros import Tracker
from phd_jdtc_ros.api.parameters import RECOGNISED
from phd_jdtc_ros.api.tables import table_of
from phd_jdtc_ros.asterix_bridge.configuration import resolve as resolve_bridge
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.nodes.tracker import settings as tracker_settings
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation import antenna, scenario_file, self_reports
from phd_jdtc_ros.simulation.antenna import Sending
from phd_jdtc_ros.tools import recorded_plots

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EXAMPLES = [
    (f"{page.relative_to(ROOT)}:{page.read_text()[: match.start()].count(chr(10)) + 1}", match[1])
    for page in [ROOT / "README.md", *PAGES]
    for match in re.finditer(r"^```ya?ml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
]
SCENES = [(name, text) for name, text in EXAMPLES if name.startswith("docs/scenarios.md")]
# Functions that read the examples of pages on nodes' own parameters, and all others.
RESOLVED = {
    "nodes/asterix_bridge": lambda path: (
        resolve_bridge(from_arguments.load(path, "asterix_bridge")).radars
    ),
    "nodes/hand_over": lambda path: (
        hand_over.resolve(from_arguments.load(path, "hand_over")).regions
    ),
    "outputs": lambda path: tracker_settings.resolve(from_arguments.load(path)).config.inputs,
    "": lambda path: resolve(from_arguments.load(path), SystemPlane).inputs,
}
EXAMPLES = [example for example in EXAMPLES if example not in SCENES]


@pytest.mark.parametrize(
    ("page", "examples"), [("connect_your_radar", 1), ("kinds_of_radar", 10), ("drivers", 2)]
)
def test_pages_on_radars_have_their_examples(page, examples):
    names = [name for name, _ in EXAMPLES]
    assert sum(name.startswith(f"docs/{page}.md") for name in names) == examples


def test_pages_have_scenes():
    assert len(SCENES) > 5


@pytest.mark.parametrize(("name", "text"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_every_example_is_a_parameter_file_that_resolves(tmp_path, name, text):
    path = tmp_path / "example.yaml"
    path.write_text(text)
    node = next(node for node in RESOLVED if name.startswith(f"docs/{node}") or not node)
    assert RESOLVED[node](path)


@pytest.mark.parametrize(("name", "text"), SCENES, ids=[name for name, _ in SCENES])
def test_every_example_of_the_page_on_scenarios_is_one(name, text):
    document, radars, faults = yaml.safe_load(text), resolve({}).model.radars, []
    found = scenario_file.resolve(document, radars)
    sent = antenna.read_sending(document, radars, faults)
    parts = found.targets, found.clutter, found.echoes, found.reflectors, found.platform
    uneven = any(antenna.wobble for antenna in found.antennas)
    said = uneven or any(each != Sending() for each in sent)
    told = self_reports.receptions(document, 3, faults)
    assert not faults
    assert any((*parts, found.mirrors, told)) or found.transponders is not None or said


def python_of(name):
    """Return the examples in Python of a page of the documentation."""
    page = (ROOT / "docs" / name).read_text()
    return re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


def run_all(examples):
    """Run examples one after the other and return the names that they leave."""
    found: dict = {}
    for example in examples:
        exec(compile(example, "example", "exec"), found)
    return found


def test_the_example_in_python_of_the_page_on_the_earth_runs():
    found = run_all(python_of("earth.md"))
    assert found["latitude"] == pytest.approx(50.05)
    # West of the origin meridians lean to the right.
    assert -0.01 < found["north"] < 0.0


def test_examples_of_the_page_on_python_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    found = run_all(python_of("python.md"))
    assert {*found["tracks"]["label"]} == {1, 2}
    assert found["scores"]["ospa"] < 200.0
    printed = capsys.readouterr().out
    early, late = map(int, re.search(r"(\d+) estimates before the end, (\d+) at", printed).groups())
    time = found["tracks"]["time"]
    assert re.search(r"MMSI 211234560 silent 0\.0.*\n\d no source silent (1\.00|0\.99)", printed)
    assert printed.rstrip().endswith("True")
    assert (early + late, late) == (len(time), np.count_nonzero(time > time.max() - 5 * 6.0))
    assert len(Tracker("mine.yaml").track(found["detections"]).smoothed) == early + late


def test_tables_of_the_page_on_python_are_the_trackers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "python.md").read_text()
    described = re.findall(
        r"^\| (`.*?) \|", page.split("## Tracks")[1].split("\n\n")[1], re.MULTILINE
    )
    columns = [name for cell in described for name in re.findall(r"`(\w+)`", cell)]

    assert columns == list(table_of([], ["target"]).dtype.names)
    for name in RECOGNISED:
        assert name == "sector" or f"`{name}`" in page.split("## Parameters")[0]


def test_examples_of_the_page_on_csv_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    detections = crossing.detections()
    rows = [",".join(map(str, row)) for row in zip(*detections.values(), strict=True)]
    (tmp_path / "detections.csv").write_text("\n".join(["time,range,azimuth", *rows]))

    found = run_all(python_of("csv.md"))

    with (tmp_path / "tracks.csv").open() as file:
        written = list(csv.DictReader(file))
    assert {row["label"] for row in written} == {"1", "2"}
    assert not any("covariance" in name for name in written[0])
    assert [float(row["x"]) for row in written] == found["tracks"]["x"].tolist()
    radars = recorded_plots.recognised_radars(BagReader(tmp_path / "bag"))
    assert radars["sensors"] == ["radar"]


def test_script_of_the_page_on_csv_writes_a_cloud_for_each_revolution(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time = 1.7e9 + 0.5 + np.arange(400) * 0.0375
    lines = [f"{each:.4f},{5e3 + each % 7.0},{each % 1.5 * 4.0}" for each in time]
    (tmp_path / "detections.csv").write_text("\n".join(["time,range,azimuth", *lines]))
    *_, script = python_of("csv.md")

    run_all([script.replace("REVOLUTION_S = 0.0", "REVOLUTION_S = 1.5")])

    bag = BagReader(tmp_path / "bag")
    given = recorded_plots.recognised_radars(bag)
    assert (given["radar.fields.time"], given["radar.units.time"]) == ("time", "s")
    plots = recorded_plots.read(bag, from_arguments.config_of(given), 100.0).plots["radar"]
    assert plots.timed
    assert len(plots.cloud_s) == 11
    times = plots.time_s + plots.zero_ns / 1e9
    np.testing.assert_allclose(times, np.round(time, 4), atol=1e-5)


def test_parameters_in_the_table_of_the_page_on_csv_are_some():
    page = (ROOT / "docs" / "csv.md").read_text()
    given = [ast.literal_eval(text) for text in re.findall(r"`(?:Tracker\()?(\{.*?\})\)?`", page)]

    assert len(given) == 4
    for parameters in given:
        assert Tracker(parameters).parameters


def test_readmes_python_example_prints_four_tracks_to_their_end(capsys):
    page = (ROOT / "README.md").read_text()
    found = run_all(re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE))

    printed = capsys.readouterr().out
    assert {*re.findall(r"track (\d+), class_[01] at", printed)} == {"1", "2", "3", "4"}
    assert found["tracks"]["time"].max() == found["run"].truth["time"].max()
    assert float(re.search(r"^OSPA ([\d.]+) m$", printed, re.MULTILINE)[1]) < 80.0
