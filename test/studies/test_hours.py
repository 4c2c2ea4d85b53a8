"""The study of hours, in a short form, from recordings to goals."""

import json
import time

import pytest

from phd_jdtc_ros import __main__ as executables
from phd_jdtc_ros.exit_status import FAILED, OK, USAGE
from studies.command import main
from studies.hours import study
from studies.hours.goals import WAYS

SHORT = ["--minutes", "2", "--hour", "en_route_hour"]


def run_here(name, *arguments):
    """Run an executable in this process, which has loaded all of them."""
    begin = time.process_time()
    status = executables.run(name, [*map(str, arguments)])
    return study.Run(status, time.process_time() - begin, "")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Return the exit status of the study of some minutes, and its directories."""
    place = tmp_path_factory.mktemp("hours")
    out, kept = place / "out", place / "kept"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run", run_here)
        status = main(["hours", *SHORT, "--out", str(out), "--keep", str(kept)])
    return status, out, kept


def test_hours_writes_figures_and_goals(ran):
    status, out, kept = ran
    assert status == OK
    found = json.loads((out / "hours.json").read_text())
    ways = found["hours"]["en_route_hour"]
    assert set(ways) == set(WAYS)
    for each in ways.values():
        assert each["cpu_s"] > 0.0
        assert set(each["scores"]) == {"filtered", "smoothed"}
        assert each["plot_kalman"]["instants"] > 100
    assert json.loads((out / "summary.json").read_text())["goals"] == found["goals"]
    assert (kept / "en_route_hour" / "recording.pcap").stat().st_size > 10_000


def test_hours_scores_a_bag_as_the_study_did(ran, capsys):
    _, out, kept = ran
    tracked = kept / "en_route_hour" / "out"
    assert main(["hour_of_bag", str(tracked), *SHORT, "--out", str(out)]) == OK
    shown = capsys.readouterr().out
    peer = json.loads((out / "hours.json").read_text())
    peer = peer["hours"]["en_route_hour"]["nothing set"]["plot_kalman"]
    assert f"{100.0 * peer['found']:.2f}" in shown
    assert f"{peer['rms']:.1f}" in shown


def test_hours_fails_where_a_recording_gives_no_tracks(tmp_path, monkeypatch):
    def nothing(hour, config, document, path):
        path.write_bytes(b"no ASTERIX")

    monkeypatch.setattr(study, "record", nothing)
    out = tmp_path / "out"
    assert main(["hours", *SHORT, "--out", str(out)]) == FAILED
    (goal,) = json.loads((out / "hours.json").read_text())["goals"]
    assert (goal["name"], goal["reached"]) == ("en_route_hour: exit status, nothing set", False)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        (["--seed", "-1"], "--seed: -1 given"),
        (["--minutes", "1"], "--minutes: 1.0 given, must be at least 2"),
        (["--keep", "."], "already exists"),
    ],
)
def test_hours_names_what_is_wrong(given, fault, capsys):
    assert main(["hours", *SHORT[2:], *given]) == USAGE
    assert fault in capsys.readouterr().err
