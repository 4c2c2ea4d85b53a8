"""The command that finds the systematic errors of radars in a recording."""

import struct

import biased
import pytest
import yaml
from bag_content import rewrite
from full_disk import largest_file

from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.parameter_files import from_arguments

# As much of the recording as has common tracks.
SHORT = ("--seconds", "100")


def register(*arguments):
    return run("register", [str(argument) for argument in arguments])


def simulated(directory, document, seed=5):
    """Simulate a scenario into a bag."""
    file = directory / "scenario.yaml"
    file.write_text(yaml.safe_dump(document))
    bag = directory / "bag"
    assert run("simulate", ["--scenario", str(file), "--out", str(bag), "--seed", str(seed)]) == 0
    return bag


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return simulated(tmp_path_factory.mktemp("biased"), biased.document())


@pytest.fixture(scope="module")
def registered(bag, tmp_path_factory):
    """Return the file that was written, and what is printed."""
    out = tmp_path_factory.mktemp("registered") / "found.yaml"
    assert register(bag, "--out", out) == 0
    return out


@pytest.fixture
def changed(bag, tmp_path):
    """Return a function that writes the bag's parameters with changes."""

    def write(**changes):
        given = {**from_arguments.load(bag / "parameters.yaml"), **changes}
        left_out = {"west", "east", "south"}.difference(given["sensors"])
        given = {k: v for k, v in given.items() if k.partition(".")[0] not in left_out}
        file = tmp_path / "changed.yaml"
        file.write_text(yaml.safe_dump({"/**/tracker": {"ros__parameters": given}}))
        return file

    return write


def test_register_writes_a_file_with_which_the_tracker_removes_the_errors(bag, registered):
    before = from_arguments.config_of(from_arguments.load(bag / "parameters.yaml"))
    after = from_arguments.config_of(from_arguments.load(registered))
    found = {name for name, value in after.values.items() if before.values[name] != value}
    assert found == {f"{radar}.biases" for radar in ("west", "east", "south")}
    assert after.values["west.biases"][3] == 0.0
    east = after.values["east.biases"]
    assert east[0] == pytest.approx(80.0, abs=32.0)
    assert east[1] == pytest.approx(0.0, abs=5e-4)
    assert east[2] == pytest.approx(0.3, abs=0.04)
    assert east[3] == pytest.approx(0.5, abs=0.15)
    lines = [row for row in registered.read_text().splitlines() if "biases:" in row]
    assert len(lines) == 3
    # Each with the deviations; one clock is the reference.
    assert all("# +-[" in line and "common tracks" in line for line in lines)
    assert ["-]" in line for line in lines].count(True) == 1


def test_register_draws_the_residuals_beside_its_file(registered):
    data = registered.with_suffix(".png").read_bytes()
    assert data.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", data[16:24])
    assert width >= 1200
    assert height >= 700


def test_register_finds_nothing_more_once_its_file_is_used(bag, registered, tmp_path, capsys):
    again = tmp_path / "again.yaml"
    assert register(bag, "--params", registered, "--out", again, "--reference", "west") == 0
    first, second = (from_arguments.load(path)["east.biases"] for path in (registered, again))
    for entry, tolerance in ((0, 4.0), (2, 0.005), (3, 0.02)):
        assert second[entry] == pytest.approx(first[entry], abs=tolerance)
    said = capsys.readouterr().out
    assert "Not observable where common to all radars: a time offset" in said
    assert "residuals of plots" in said


def test_register_without_out_writes_nothing(bag, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert register(bag, *SHORT) == 0
    said = capsys.readouterr().out
    assert "nothing is written without --out FILE" in said
    assert "the reference: taken to be right" in said
    assert not list(tmp_path.glob("*.png"))


def test_register_overwrites_nothing(bag, tmp_path, capsys):
    out, drawn = tmp_path / "mine.yaml", tmp_path / "other.png"
    out.write_text("mine")
    drawn.write_text("mine too")
    assert register(bag, "--out", out) == 2
    assert register(bag, "--out", tmp_path / "other.yaml") == 2
    assert capsys.readouterr().err.count("already exists") == 2
    assert (out.read_text(), drawn.read_text()) == ("mine", "mine too")


@pytest.mark.parametrize(
    ("changes", "arguments", "reason"),
    [
        ({"sensors": ["west"]}, (), "west alone given, must be at least two to compare"),
        ({"east.fields.time": ""}, SHORT, "have no individual times; map them with fields.time"),
        ({"east.position": [9e5, 0.0]}, SHORT, "no common targets: east has"),
        ({"east.topic": "/nowhere"}, (), "/nowhere"),
        ({"east.range_bais": 3.0}, (), "east.range_bais: unknown parameter"),
        ({"east.range_std": 0.01, "east.azimuth_std_deg": 1e-5}, SHORT, "range_std and azimuth"),
        ({}, ("--reference", "north"), "north given, must be one of west, east, south"),
        ({}, ("--seconds", "25"), "must be"),
        ({}, ("--seconds", "soon"), "soon given, must be a number of at least 1 s"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_register_reports_what_is_wrong_and_allowed(
    bag, changed, changes, arguments, reason, capsys
):
    try:
        status = register(bag, "--params", changed(**changes), *arguments)
    except SystemExit as stopped:  # Argparse says so
        status = stopped.code
    assert status == 2
    said = capsys.readouterr().err
    assert reason in said
    assert "Traceback" not in said


def test_register_of_no_bag_does_not_ask_for_parameters(tmp_path, capsys):
    assert register(tmp_path / "none") == 2
    assert capsys.readouterr().err == f"register: {tmp_path / 'none'}: no such bag\n"


def test_register_names_a_picture_for_which_there_is_no_room(bag, tmp_path, capsys):
    with largest_file(1000):
        assert register(bag, *SHORT, "--picture", tmp_path / "drawn.png") == 2
    assert capsys.readouterr().err == f"register: {tmp_path / 'drawn.png'}: File too large\n"
    assert not (tmp_path / "drawn.png").exists()


def test_register_names_a_silent_radar(bag, tmp_path, capsys):
    silent = "/south/detections"
    kept = rewrite(bag, tmp_path / "kept", lambda e: [] if e[0] == silent else [e])
    params = bag / "parameters.yaml"
    assert register(kept) == 2
    assert register(kept, "--params", params) == 2
    said = capsys.readouterr().err
    assert "give a parameter file as --params" in said
    assert "south: silent, no detections on /south/detections; must have some" in said


def test_register_refuses_what_targets_on_one_line_do_not_determine(tmp_path, capsys):
    # All of them fly along the line through both radars, as fast as each other.
    document = biased.document(biases={})
    document["parameters"]["sensors"] = ["west", "east"]
    for name in ("west", "east"):
        document["parameters"][name]["position"] = [-3e4 if name == "west" else 3e4, 0.0]
    del document["parameters"]["south"], document["traffic"]
    document["targets"] = [
        {
            "class_id": 0,
            "position": [-25e3 + 9e3 * k, 0.0],
            "velocity": [60.0, 0.0],
            "legs": [{"duration_s": 240.0}],
        }
        for k in range(3)
    ]
    out = tmp_path / "found.yaml"
    assert register(simulated(tmp_path, document), "--out", out) == 0
    said = capsys.readouterr().out
    assert "range gain, m/m and time, s not observable: 3 common tracks with" in said
    assert "all on one line" in said
    assert "a time offset, a range gain, a range bias; west is taken to be right there" in said
    # Nothing is written of them.
    written = from_arguments.load(out)
    assert written["east.biases"][1] == written["east.biases"][3] == 0.0
    assert written["east.biases"][2] != 0.0


def test_register_refuses_elevations(capsys):
    assert register("drones") == 2
    assert "state: space given, must be plane for register" in capsys.readouterr().err
