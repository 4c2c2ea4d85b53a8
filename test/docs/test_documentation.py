"""All pages of the documentation are in the site, and their figures and names are right."""

import re
from importlib import import_module
from pathlib import Path

import docstrings
import page_tables
import pytest
import yaml

from phd_jdtc_ros.__main__ import EXECUTABLES
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.targets.amplitude_density import of_classes

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"
TEXTS = [README, CONTRIBUTING, *PAGES]
NAVIGATION = yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]


def test_every_page_is_in_the_sites_navigation():
    listed = set(re.findall(r"[\w/]+\.md", str(NAVIGATION)))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES}
    assert pages == listed - docstrings.described(NAVIGATION).keys()


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
    texts = [page.read_text() for page in [*TEXTS, *(ROOT / "launch").glob("*.py")]]
    used = {
        (name, argument)
        for name, rest in named(r"(\w+\.launch\.py)((?:[ \[]+\w+:=[^\s`]+)+)", texts)
        for argument in re.findall(r"(\w+):=", rest)
    }

    assert len({name for name, _ in used}) == 2
    assert {(n, argument) for n, argument in used if argument not in launch_arguments(n)} == set()


def test_time_of_a_scan_is_that_of_the_performance_page():
    performance = (ROOT / "docs" / "performance.md").read_text()
    steps = {
        shown["bench"].partition(", CPU")[0]: dict(zip(cells[0][1:], cells[1][1:], strict=True))
        for shown, cells in page_tables.specified(performance)
    }
    few, many = (
        f"{float(steps['the whole step, gaussian'][column]):.0f} ms"
        for column in ("4 targets", "200 targets")
    )
    intro = " ".join(performance.split("## ")[0].split())

    assert f"takes {few} of one core, filter" in intro
    assert f"300 detections per radar take {many}" in intro
    assert f"takes {few} of one core" in " ".join(README.read_text().split())
    # The figures that one command has measured are on that page only.
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
        threshold = config.model.radars[0].threshold
        (found,) = of_classes(threshold, config.model.modes.classes)
        assert found == pytest.approx(probability, abs=0.005)


COMMANDS = [line for page in TEXTS for line in page.read_text().replace("\\\n", " ").splitlines()]


def named(pattern, lines=COMMANDS):
    """Return what a pattern finds in the lines of all texts."""
    return {found for line in lines for found in re.findall(pattern, line.strip())}


def test_executables_make_targets_and_cases_of_studies_in_the_text_exist():
    executables = named(r"(?:ros2 run phd_jdtc_ros|-m phd_jdtc_ros) (\w+)") - {"NAME"}
    assert len(executables) > 10
    assert executables <= {*EXECUTABLES}

    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    used = named(r"(?:^|`)make ([a-z]+)")
    assert len(used) > 10
    assert used <= {*targets}

    study = yaml.safe_load((ROOT / "config" / "studies" / "published.yaml").read_text())
    pattern = re.compile("-m (phd_jdtc_ros|studies) monte_carlo")
    studies = [line for line in COMMANDS if pattern.search(line)]
    chosen = named(r'--(case|variant) (?:"([^"]+)"|(\w\S*))', studies)
    assert {option for option, *_ in chosen} == {"case", "variant"}
    assert {(o, q or p) for o, q, p in chosen if (q or p) not in study[f"{o}s"]} == set()


def test_files_in_the_text_exist():
    paths = {
        path
        for path in named(r"`((?:[\w.]+/)+(?:[\w-]+\.\w+)?)`")
        if "NAME" not in path and not path.startswith(("out/", "keys/"))
    }
    # The method's paths begin in the package.
    roots = (ROOT, ROOT / "phd_jdtc_ros")

    assert len(paths) > 40
    assert {path for path in paths if not any((root / path).exists() for root in roots)} == set()


def names_of(path):
    """Return the names that a module has, those of its classes' members as CLASS.MEMBER."""
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    names = {*vars(module)}
    for name, found in vars(module).items():
        if isinstance(found, type):
            names |= {f"{name}.{own}" for own in (*dir(found), *found.__annotations__)}
    return names


def test_code_that_the_method_names_exists():
    modules = {}  # Both engines have modules of the same names
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
    pages = docstrings.described(NAVIGATION)
    assert [path for path, folders in pages.items() if not folders] == []
    described = [folder for folders in pages.values() for folder in folders]
    tops = ("phd_jdtc_ros", "msg_adapters", "benchmarks", "robustness", "studies")
    packages = [path.parent for top in tops for path in (ROOT / top).rglob("__init__.py")]

    assert sorted(described) == sorted({*packages} - {ROOT / "phd_jdtc_ros"})


def test_drawing_of_the_house_has_the_parts_of_the_contract():
    text = (ROOT / "pyproject.toml").read_text()
    layers = re.search(r"^layers = \[\n(.*?)^\]", text, re.DOTALL | re.MULTILINE)[1]
    parts = {name.removeprefix("phd_jdtc_ros.") for name in re.findall(r"[\w.]+", layers)}
    drawn = re.findall(r">(\w+)</text>", (ROOT / "docs" / "images" / "house.svg").read_text())
    packages = {p for p in parts if (ROOT / "phd_jdtc_ros" / p).is_dir()} | {
        "msg_adapters",
        "earth",
        "feed",
        "report_bridge",
        "asterix_bridge",
    }

    assert packages <= parts
    assert packages <= {*drawn}
    rooms = {path.parent.name for path in (ROOT / "phd_jdtc_ros" / "core").glob("*/__init__.py")}
    assert {*drawn} - packages == rooms
