"""An installed package, away from its checkout."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from phd_jdtc_ros.__main__ import EXECUTABLES
from phd_jdtc_ros.report.page.html import SCRIPTS

ROOT = Path(__file__).parents[2]
SOURCES = (
    *("phd_jdtc_ros", "msg_adapters", "launch", "rviz", "foxglove", "config", "bags", "resource"),
    *("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "README.md"),
)


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """Return a directory that the package is installed into; not editable."""
    home = tmp_path_factory.mktemp("installed")
    # It is built from a copy, because a build leaves files among its sources.
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (home / "source").mkdir(exist_ok=True)
        copy(ROOT / name, home / "source" / name)
    # The steps of pip with a target directory, whether it has the package `wheel` to do it or not.
    target = home / "target"
    subprocess.run(
        [
            *(sys.executable, "setup.py", "--quiet"),
            *("install_lib", "-d", target, "install_data", "-d", target),
            *("install_egg_info", "-d", target, "install_scripts", "-d", target / "bin"),
        ],
        cwd=home / "source",
        check=True,
        capture_output=True,
        text=True,
    )
    shutil.rmtree(home / "source")
    # The files are the checkout's, with their times, and so is what is compiled of them. This
    # spares each process most of a minute.
    for compiled in (ROOT / "phd_jdtc_ros").rglob("__pycache__/*.nb?"):
        copy = target / compiled.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(compiled, copy)
    return target


def run(installed, directory, *arguments, **environment):
    """Run Python with the installed package from another directory."""
    return start(installed, directory, sys.executable, *arguments, **environment)


def start(installed, directory, *command, **environment):
    """Run a command with the installed package from another directory."""
    done = subprocess.run(
        [*map(str, command)],
        cwd=directory,
        env={**os.environ, "PYTHONPATH": str(installed), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_an_installed_package_finds_its_files_from_any_directory(installed, tmp_path):
    text = (
        "import os\n"
        "from phd_jdtc_ros import resources\n"
        "from phd_jdtc_ros.tools import monte_carlo\n"
        "import phd_jdtc_ros\n"
        # The tests' own profile would be kept.
        "for name in resources.PROFILE_VARIABLES: os.environ.pop(name)\n"
        "print(phd_jdtc_ros.__file__, resources.bag('paper_scenario'),"
        " *resources.isolation().values(), resources.find(monte_carlo.PUBLISHED))\n"
    )
    status, out, err = run(installed, tmp_path, "-c", text)
    assert status == 0, err
    # A new installation compiles as the engines are imported.
    assert [line for line in err.splitlines() if not line.startswith("compiling the tracker")] == []
    package, bag, *others = map(Path, out.split())
    assert package.is_relative_to(installed)
    assert (bag / "metadata.yaml").is_file()
    assert len(others) == 3
    assert all(
        path.is_relative_to(installed) and path.is_file() for path in [bag / "x", *others][1:]
    )


def test_every_executable_and_shipped_file_is_installed(installed):
    assert {path.name for path in (installed / "bin").iterdir()} == {*EXECUTABLES}
    share = installed / "share" / "phd_jdtc_ros"
    for folder in ("bags", "config", "foxglove", "launch", "rviz"):
        shipped = {p for p in (ROOT / folder).rglob("*.*") if p.suffix not in (".pyc", ".md")}
        found = {ROOT / path.relative_to(share) for path in (share / folder).rglob("*.*")}
        assert {path for path in shipped if path.is_file()} <= found, folder
    assets = Path("phd_jdtc_ros", "report", "page", "assets")
    found = {path.name for path in (installed / assets).iterdir()}
    assert found == {"live.html", "live.js", "page.css", "page.html", *SCRIPTS}


def test_an_installed_node_starts_from_an_empty_directory(installed, tmp_path):
    # The others run in the installed demo.
    status, out, err = start(installed, tmp_path, installed / "bin" / "tracker", "--help")
    assert (status, err) == (0, "")
    assert out.startswith("usage: tracker")
    assert not [*tmp_path.iterdir()]


def test_installed_offline_scripts_work_from_an_empty_directory(installed, tmp_path, scenario_file):
    # The installed demo tracks and writes a report too.
    for name, *arguments in (
        ("simulate", "--scenario", scenario_file, "--out", "short"),
        ("track_bag", "short", "--out", "tracked"),
    ):
        status, _, err = start(installed, tmp_path, installed / "bin" / name, *arguments)
        assert status == 0, err
    assert (tmp_path / "tracked" / "metadata.yaml").is_file()


@pytest.mark.live
def test_installed_demo_runs_from_an_empty_directory(installed, tmp_path, short_bag):
    """The nodes are those of the installation too, whatever else there is."""
    status, _, err = start(*(installed, tmp_path, installed / "bin" / "demo", "--bag", short_bag))
    assert status == 0, err
    out = tmp_path / "out" / "demo_short"
    assert json.loads((out / "metrics.json").read_text())["scans"] == 8
    assert (out / "report.html").is_file()


def test_without_ros_a_node_names_the_extra_in_one_line(installed, tmp_path):
    blocked = "import sys\nsys.modules['rclpy'] = None\n"
    (tmp_path / "sitecustomize.py").write_text(blocked)
    path = f"{tmp_path}{os.pathsep}{installed}"
    status, out, err = run(
        installed, tmp_path, "-m", "phd_jdtc_ros", "tracker", "--help", PYTHONPATH=path
    )
    assert (status, out) == (2, "")
    assert err == (
        "tracker: rclpy is not installed; source a ROS 2 installation, or install the parts of it "
        "that are needed with the package: pip install '.[ros]'\n"
    )
