"""The documentation's examples work, its pages are all in the site, and what it names exists."""

import ast
import csv
import re
from importlib import import_module
from pathlib import Path

import crossing
import numpy as np
import page_tables
import pytest
import yaml

import phd_jdtc_ros
from phd_jdtc_ros import Tracker
from phd_jdtc_ros.__main__ import EXECUTABLES
from phd_jdtc_ros.api.parameters import RECOGNISED
from phd_jdtc_ros.api.tables import table_of
from phd_jdtc_ros.asterix_bridge import settings
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.simulation import scenario_file, sending
from phd_jdtc_ros.simulation.sending import Sending
from phd_jdtc_ros.tools import recorded_plots
from phd_jdtc_ros.tools.demo import demo

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"
TEXTS = [README, CONTRIBUTING, *PAGES]
EXAMPLES = [
    (f"{page.relative_to(ROOT)}:{page.read_text()[: match.start()].count(chr(10)) + 1}", match[1])
    for page in [ROOT / "README.md", *PAGES]
    for match in re.finditer(r"^```ya?ml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
]
SCENES = [(name, text) for name, text in EXAMPLES if name.startswith("docs/scenarios.md")]
# What is read of the examples of other nodes' pages, and of all others.
RESOLVED = {
    "asterix_bridge": lambda path: (
        settings.resolve(from_arguments.load(path, "asterix_bridge")).radars
    ),
    "hand_over": lambda path: hand_over.resolve(from_arguments.load(path, "hand_over")).regions,
    "": lambda path: resolve(from_arguments.load(path), SystemPlane).inputs,
}
EXAMPLES = [example for example in EXAMPLES if example not in SCENES]


@pytest.mark.parametrize(
    ("page", "examples"), [("connect_your_radar", 1), ("kinds_of_radar", 4), ("drivers", 2)]
)
def test_pages_on_radars_have_their_examples(page, examples):
    names = [name for name, _ in EXAMPLES]
    assert sum(name.startswith(f"docs/{page}.md") for name in names) == examples


@pytest.mark.parametrize(("name", "text"), EXAMPLES, ids=[name for name, _ in EXAMPLES])
def test_every_example_is_a_parameter_file_that_resolves(tmp_path, name, text):
    path = tmp_path / "example.yaml"
    path.write_text(text)
    node = next(node for node in RESOLVED if name.startswith(f"docs/nodes/{node}") or not node)
    assert RESOLVED[node](path)


@pytest.mark.parametrize(("name", "text"), SCENES, ids=[name for name, _ in SCENES])
def test_every_example_of_the_page_on_scenarios_is_one(name, text):
    document, radars, faults = yaml.safe_load(text), resolve({}).model.radars, []
    found = scenario_file.resolve(document, radars)
    sent = sending.of_radars(document, radars, faults)
    assert not faults

    parts = found.targets, found.clutter, found.echoes, found.reflectors, found.platform
    uneven = any(antenna.wobble for antenna in found.antennas)
    said = uneven or any(each != Sending() for each in sent)
    assert any((*parts, found.mirrors)) or found.transponders is not None or said


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
    assert [float(row["x"]) for row in written] == found["tracks"]["x"].tolist()
    radars = recorded_plots.recognised_radars(BagReader(tmp_path / "bag"))
    assert radars["sensors"] == ["radar"]


def test_parameters_in_the_table_of_the_page_on_csv_are_some():
    page = (ROOT / "docs" / "csv.md").read_text()
    given = [ast.literal_eval(text) for text in re.findall(r"`(?:Tracker\()?(\{.*?\})\)?`", page)]

    assert len(given) == 5
    for parameters in given:
        assert Tracker(parameters).parameters


def test_plots_of_the_page_on_other_inputs_are_where_targets_are():
    (example,) = python_of("other_inputs.md")
    plots_of = run_all([example])["plots_of"]
    rng = np.random.default_rng(1)
    video = rng.rayleigh(1.0, (720, 600))
    places = ((100, 50), (400, 300), (650, 580))
    for spoke, column in places:
        video[spoke - 1 : spoke + 2, column - 1 : column + 2] += 12.0
    azimuth = np.mod(1.0 + np.arange(720) * 2.0 * np.pi / 720, 2.0 * np.pi)

    found = plots_of(video, azimuth, 10.0 + np.arange(720) / 300.0, cell=5.0)

    assert found["range"] == pytest.approx([5.0 * (column + 0.5) for _, column in places], abs=2.5)
    assert found["time"] == pytest.approx([10.0 + spoke / 300.0 for spoke, _ in places], abs=0.002)
    angle = found["azimuth"] - [1.0 + spoke * 2.0 * np.pi / 720 for spoke, _ in places]
    assert np.abs(np.exp(1j * angle) - 1.0).max() < 0.005
    assert (found["amplitude"] > 4.0).all()


def test_every_page_is_in_the_sites_navigation():
    navigation = str(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    listed = {ROOT / "docs" / name for name in re.findall(r"[\w/]+\.md", navigation)}
    assert {*PAGES} == listed


def launch_arguments(name):
    """Return the arguments that a launch file declares, by themselves or in tables."""
    text = (ROOT / "launch" / name).read_text()
    tables = re.findall(r"^(?:\w*ARGUMENTS|FLAGS) = \{(.*?)^\}", text, re.DOTALL | re.MULTILINE)
    return {
        *re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text),
        *re.findall(r'^    "(\w+)":', "".join(tables), re.MULTILINE),
    }


def test_launch_page_lists_the_arguments_of_the_launch_files():
    page = (ROOT / "docs" / "launch.md").read_text()
    table = page.split("| launch file | argument |")[1].split("\n\n")[0]
    listed = {
        word for row in table.splitlines()[2:] for word in re.findall(r"`(\w+)`", row.split("|")[2])
    }

    assert listed == launch_arguments("tracker.launch.py") | launch_arguments("demo.launch.py")


def test_launch_commands_in_the_text_use_arguments_that_there_are():
    used = [
        (name, argument)
        for page in [*TEXTS, *(ROOT / "launch").glob("*.py")]
        for name, rest in re.findall(
            r"(\w+\.launch\.py)((?:[ \[]+\w+:=[^\s`]+)+)", page.read_text()
        )
        for argument in re.findall(r"(\w+):=", rest)
    ]

    assert len({name for name, _ in used}) == 2
    assert not [
        (name, argument) for name, argument in used if argument not in launch_arguments(name)
    ]


def test_readmes_python_example_prints_four_tracks_to_their_end(capsys):
    page = README.read_text()
    found = run_all(re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE))

    printed = capsys.readouterr().out
    assert {*re.findall(r"track (\d+), class_[01] at", printed)} == {"1", "2", "3", "4"}
    assert found["tracks"]["time"].max() == found["run"].truth["time"].max()
    assert float(re.search(r"^OSPA ([\d.]+) m$", printed, re.MULTILINE)[1]) < 80.0


@pytest.mark.parametrize("engine", ["particles", "gaussian"])
def test_readmes_table_has_the_scores_of_the_shipped_bag(tmp_path, engine):
    (row,) = re.findall(rf"^\| {engine}, \w+ \|(.+)\|$", README.read_text(), re.MULTILINE)
    bag = ROOT / "bags" / "paper_scenario"
    config = resolve({**bag_parameters.read(bag), "engine": engine}, SystemPlane)

    found = demo.scores(bag, config, tmp_path / "bag")

    ospa = [f"{found[source]['all']['ospa']:.1f} m" for source in ("filtered", "smoothed")]
    shares = [f"{found['reduction']:.0%}", f"{found['class_accuracy']:.1%}"]
    assert [cell.strip() for cell in row.split("|")] == [
        *ospa,
        *(share.replace("%", " %") for share in shares),
    ]


def test_time_of_a_scan_is_that_of_the_performance_page():
    performance = (ROOT / "docs" / "performance.md").read_text()
    steps = {
        shown["bench"].split(",")[1].split()[-1]: dict(zip(cells[0][1:], cells[1][1:], strict=True))
        for shown, cells in page_tables.specified(performance)
        if shown["bench"].startswith("the whole step, engine")
    }
    few, many = (
        {engine: f"{float(ms[column]):.0f}" for engine, ms in steps.items()}
        for column in ("4 targets", "200 targets")
    )
    intro = " ".join(performance.split("## ")[0].split())

    assert f"takes {few['particles']} ms of one core, filter" in intro
    assert f"take {many['particles']} ms" in intro
    assert f"`engine: gaussian` it is {few['gaussian']} ms, and {many['gaussian']} ms" in intro
    sentence = f"takes {few['particles']} ms of one core with particles and {few['gaussian']} ms"
    assert sentence in " ".join(README.read_text().split())
    # What was measured once, with one command, is on that page only.
    for name in ("tracker", "sensor_replay"):
        text = (ROOT / "docs" / "nodes" / f"{name}.md").read_text()
        assert "[performance](../performance.md)" in text.lower()
        assert not re.findall(r"\d ms", text)


def test_detection_probabilities_without_amplitudes_are_those_of_the_radar_page():
    page = (ROOT / "docs" / "kinds_of_radar.md").read_text()
    rows = re.findall(r"^\| (?:prob|lower end)[^|]* \|(.+)\|$", page, re.MULTILINE)
    probabilities, bands = ([float(cell) for cell in row.split("|")] for row in rows)

    assert len(probabilities) == len(bands) == 5
    for probability, low in zip(probabilities, bands, strict=True):
        config = resolve(
            {
                "sensors": ["one"],
                "classes": ["target"],
                "births": [],
                "one.fields.amplitude": "",
                "one.false_alarm_probability": 0.001,
                "target.snr_band_db": [low, low + 0.1],
            }
        )
        (found,) = config.model.radars[0].class_detection_probability(config.model.modes.classes)
        assert found == pytest.approx(probability, abs=0.005)


COMMANDS = [
    (str(page.relative_to(ROOT)), line)
    for page in TEXTS
    for line in page.read_text().replace("\\\n", " ").splitlines()
]


def test_executables_in_the_text_exist():
    used = {
        (page, name)
        for page, line in COMMANDS
        for name in re.findall(r"(?:ros2 run phd_jdtc_ros|-m phd_jdtc_ros) (\w+)", line)
        if name != "NAME"
    }

    assert len(used) > 10
    assert {(page, name) for page, name in used if name not in EXECUTABLES} == set()


def test_make_targets_in_the_text_exist():
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    used = {
        (page, name)
        for page, line in COMMANDS
        for name in re.findall(r"(?:^|`)make ([a-z]+)", line.strip())
    }

    assert len(used) > 10
    assert {(page, name) for page, name in used if name not in targets} == set()


def study_commands():
    """Return the cases and variants that commands in the text pick."""
    return [
        (option, quoted or plain)
        for _, line in COMMANDS
        if "-m phd_jdtc_ros monte_carlo" in line
        for option, quoted, plain in re.findall(r'--(case|variant) (?:"([^"]+)"|(\w\S*))', line)
    ]


def test_cases_and_variants_of_study_commands_exist():
    study = yaml.safe_load((ROOT / "config" / "studies" / "published.yaml").read_text())
    used = study_commands()

    assert {option for option, _ in used} == {"case", "variant"}
    assert [(option, name) for option, name in used if name not in study[f"{option}s"]] == []


def test_files_in_the_text_exist():
    named = [
        (str(page.relative_to(ROOT)), path)
        for page in TEXTS
        for path in re.findall(r"`((?:[\w.]+/)+(?:[\w-]+\.\w+)?)`", page.read_text())
        if "NAME" not in path and not path.startswith(("out/", "keys/"))
    ]
    # The method's paths begin in the package.
    roots = (ROOT, ROOT / "phd_jdtc_ros")

    assert len(named) > 40
    assert [
        (page, path) for page, path in named if not any((root / path).exists() for root in roots)
    ] == []


def names_of(path):
    """Return the names that a module has, those of its classes' members as CLASS.MEMBER."""
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    names = {*vars(module)}
    for name, found in vars(module).items():
        if isinstance(found, type):
            names |= {f"{name}.{own}" for own in (*dir(found), *found.__annotations__)}
    return names


def test_code_that_the_method_names_exists():
    modules = {}  # both engines have modules of the same names
    for path in (ROOT / "phd_jdtc_ros" / "core").rglob("*.py"):
        modules.setdefault(path.stem, []).append(path)
    text = (ROOT / "docs" / "method.md").read_text()
    named = [pair for pair in re.findall(r"`(\w+)\.([\w.]+)`", text) if pair[0] in modules]
    assert len(named) > 12
    missing = [
        (module, name)
        for module, name in named
        if not any(name in names_of(path) for path in modules[module])
    ]
    assert missing == []


def test_every_folder_of_the_source_is_on_a_page():
    text = "\n".join(page.read_text() for page in (ROOT / "docs" / "code").rglob("*.md"))
    described = re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE)
    tops = ("phd_jdtc_ros", "msg_adapters", "benchmarks", "robustness", "studies")
    packages = [
        ".".join(path.parent.relative_to(ROOT).parts)
        for top in tops
        for path in (ROOT / top).rglob("__init__.py")
    ]

    assert sorted(described) == sorted({*packages} - {"phd_jdtc_ros"})


def test_drawing_of_the_house_has_the_parts_of_the_contract():
    text = (ROOT / "pyproject.toml").read_text()
    layers = re.search(r"^layers = \[\n(.*?)^\]", text, re.DOTALL | re.MULTILINE)[1]
    parts = {name.removeprefix("phd_jdtc_ros.") for name in re.findall(r"[\w.]+", layers)}
    drawn = re.findall(r">(\w+)</text>", (ROOT / "docs" / "images" / "house.svg").read_text())
    packages = {p for p in parts if (ROOT / "phd_jdtc_ros" / p).is_dir()} | {
        "msg_adapters",
        "earth",
    }

    assert packages <= parts
    assert packages <= {*drawn}
    rooms = {path.name for path in (ROOT / "phd_jdtc_ros" / "core").iterdir() if path.is_dir()}
    assert {*drawn} - packages <= rooms


def test_citation_agrees_with_the_package():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    manifest = (ROOT / "package.xml").read_text()

    assert citation["version"] == phd_jdtc_ros.__version__
    assert all(f">{author['name']}</maintainer>" in manifest for author in citation["authors"])
    assert f">{citation['license']}</license>" in manifest
    assert (
        f"{citation['version']} ({citation['date-released']})"
        in (ROOT / "CHANGELOG.rst").read_text()
    )


def commands_of(workflow):
    """Return the commands that a workflow's jobs run."""
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / workflow).read_text())["jobs"]
    return [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]


def test_workflow_runs_what_a_change_must_pass():
    container = ["docker build -t phd_jdtc_ros .", "docker run --rm phd_jdtc_ros"]
    speed = ["make setup", ".venv/bin/python -m benchmarks.gate HEAD~1"]
    assert commands_of("ci.yml") == [".ci/run", "make test", "make docs", *container, *speed]
    page = (ROOT / "docs" / "container.md").read_text()
    assert all(f"    {command}\n" in page for command in container)


def test_release_has_the_wheel_and_the_site():
    commands = " ".join(commands_of("release.yml"))
    manifest = (ROOT / "package.xml").read_text()

    assert f"<version>{phd_jdtc_ros.__version__}</version>" in manifest
    assert "<version>$GITHUB_REF_NAME</version>" in commands
    assert commands.index("make docs") < commands.index("pip wheel") < commands.index("gh release")
