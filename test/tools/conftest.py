import pytest

from phd_jdtc_ros.__main__ import run

SCENARIO = """
start_s: 1000.0
interval_s: 6.0
scans: 8
targets:
  - {class_id: 0, snr_db: 45.0, position: [-10000.0, 10000.0], velocity: [36.0, -44.0],
     first_scan: 0, last_scan: 7}
  - {class_id: 1, snr_db: 25.0, position: [-10000.0, -10000.0], velocity: [36.0, 44.0],
     first_scan: 2, last_scan: 5}
"""


@pytest.fixture(scope="session")
def scenario_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "short.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture(scope="session")
def short_bag(scenario_file, tmp_path_factory):
    """Return a simulated bag of 8 scans."""
    out = tmp_path_factory.mktemp("simulated") / "short"
    assert run("simulate", ["--scenario", str(scenario_file), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="session")
def tracked(short_bag, tmp_path_factory):
    """Return what tracking the short bag wrote."""
    out = tmp_path_factory.mktemp("tracked") / "out"
    assert run("track_bag", [str(short_bag), "--out", str(out)]) == 0
    return out


@pytest.fixture
def simulate(tmp_path, scenario_file):
    """Return a function that simulates with further arguments into a new directory."""

    def start(*arguments, out="out", scenario=scenario_file):
        chosen = ["--scenario", str(scenario)] if scenario else []
        path = tmp_path / out
        return run("simulate", [*chosen, "--out", str(path), *map(str, arguments)]), path

    return start


@pytest.fixture
def track(tmp_path):
    """Return a function that tracks a bag into a new directory."""

    def start(bag, *arguments, out="out"):
        path = tmp_path / out
        return run("track_bag", [str(bag), "--out", str(path), *map(str, arguments)]), path

    return start


@pytest.fixture
def same_files():
    """Return a function that compares the content of two directories."""

    def compare(one, other):
        contents = [
            {path.name: path.read_bytes() for path in directory.iterdir()}
            for directory in (one, other)
        ]
        return contents[0] == contents[1]

    return compare


@pytest.fixture
def faults(capsys):
    """Return a function that returns the faults that `track_bag` printed, without its progress."""

    def read():
        lines = capsys.readouterr().err.splitlines()
        assert not any("Traceback" in line for line in lines)
        return [
            line.removeprefix("track_bag: ")
            for line in lines
            if line.strip() and not line.startswith("tracking ")
        ]

    return read
