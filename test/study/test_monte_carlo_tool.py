import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from phd_jdtc_ros.study import figures
from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.study.definition import FIGURES
from phd_jdtc_ros.study.tasks import HEADER
from phd_jdtc_ros.tools.monte_carlo import main

ROOT = Path(__file__).parents[2]


@pytest.fixture
def no_pictures(monkeypatch):
    """Leave out what takes most of the time and is not looked at."""
    monkeypatch.setattr(figures, "write_all", lambda *_: [])


@pytest.fixture
def in_process(monkeypatch):
    """Run tasks here, without the imports of worker processes."""

    def run_here(pending, workers, report, busy):
        for task in pending:
            report(study_tasks.perform(task))

    monkeypatch.setattr(study_tasks, "run_on_processes", run_here)


@pytest.fixture
def start(study_file, tmp_path):
    """Return a function that runs the tool on the small study into a directory of the test."""

    def run(*arguments, change=lambda document: None, out="out"):
        path = tmp_path / out
        place = [] if "--dask" in arguments else ["--workers", "1"]
        asked = ["--study", str(study_file(change)), "--out", str(path), "--runs", "2", *place]
        return main([*asked, *map(str, arguments)]), path

    return run


def parts(out):
    return {path.name: path.stat().st_mtime_ns for path in (out / "parts").iterdir()}


def rows_of(out):
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.usefixtures("in_process")
def test_main_writes_everything(start, study):
    status, out = start()
    rows = rows_of(out)
    summary = json.loads((out / "summary.json").read_text())
    assert status == 0
    assert tuple(rows[0]) == HEADER
    # Two runs and two lags of six scans and three sets, four variants.
    assert len(rows) == 2 * 2 * 6 * 3 * 4
    assert {row["variant"] for row in rows} == {variant.name for variant in study.variants}
    corrected = summary["cases"]["quiet"]["corrected"]
    assert (corrected["runs"], corrected["seeds"]) == (2, [1000, 1001])
    assert corrected["lags"].keys() == {"0", "2"}
    assert corrected["lags"]["2"].keys() == {"all", "class_0", "class_1"}
    assert corrected["lags"]["2"]["all"].keys() == {*FIGURES, "confusion"}
    assert corrected["lags"]["0"]["all"]["reduction"] is None
    assert summary["goals"][0]["reached"] is True
    assert "| corrected | 2 |" in (out / "table.md").read_text()
    assert (out / "figures" / "quiet" / "ospa_against_lag.png").exists()


@pytest.mark.usefixtures("no_pictures", "in_process")
def test_main_resumes_where_it_was(start, study_file):
    first = start("--variant", "corrected", "--runs", 1)[1]
    before = parts(first)
    status, out = start("--variant", "corrected")
    after = parts(out)
    assert status == 0
    assert len(after) == 2
    assert before.items() <= after.items()


@pytest.mark.usefixtures("no_pictures", "in_process")
def test_main_scores_with_another_cutoff_and_keeps_these_scores_apart(start):
    usual = start("--variant", "reference", "--runs", 1)[1]
    before = parts(usual)
    status, out = start("--variant", "reference", "--runs", 1, "--cutoff", 40)
    summary = json.loads((out / "summary.json").read_text())
    assert status == 0
    assert (summary["p"], summary["c"]) == (2.0, 40.0)
    assert summary["cases"]["quiet"]["reference"]["lags"]["0"]["all"]["ospa"]["mean"] <= 40.0
    assert "c = 40 m" in (out / "table.md").read_text()
    assert len(parts(out)) == 2 * len(before)


@pytest.mark.usefixtures("no_pictures")
def test_main_gives_the_same_bytes_however_it_is_run(start, request):
    chosen = ("--variant", "corrected", "--variant", "as printed")
    _, whole = start(*chosen, "--workers", 2, out="whole")
    request.getfixturevalue("in_process")
    start("--variant", "as printed", "--runs", 1, out="pieces")
    _, pieces = start(*chosen, out="pieces")
    for name in ("results.csv", "summary.json", "table.md"):
        assert (pieces / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.usefixtures("no_pictures")
def test_main_reports_failures_and_goes_on(start, monkeypatch, capsys):
    code_of = study_tasks.code_of

    def wrong(kind):
        return "other" if kind.name == "phd" else code_of(kind)

    monkeypatch.setattr(study_tasks, "code_of", wrong)
    status, out = start("--variant", "corrected", "--variant", "reference")

    summary = json.loads((out / "summary.json").read_text())
    assert status == 1
    assert [(f["variants"], f["seed"]) for f in summary["failed"]] == [
        (["corrected"], 1000),
        (["corrected"], 1001),
    ]
    assert summary["cases"]["quiet"]["reference"]["runs"] == 2
    assert "seed 1001" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["--runs", "0", "--workers", "0"], "--runs: 0 given"),
        (["--runs", "0", "--workers", "0"], "--workers: 0 given"),
        (["--first-seed", "-1"], "--first-seed: -1 given"),
        (["--case", "loud"], "--case: 'loud' given"),
        (["-p", "nonsense:=1"], "-p nonsense: unknown parameter"),
        (["--study", "absent.yaml"], "absent.yaml: cannot be read"),
        (["--variant", "GNN"], "GNN: left out, it runs with `python -m studies monte_carlo`"),
    ],
)
def test_main_refuses_wrong_arguments(start, capsys, arguments, fault):
    def change(document):
        document["variants"]["GNN"] = {"kind": "gnn"}

    status, out = start(*arguments, change=change)

    assert status == 2
    assert f"monte_carlo: {fault}" in capsys.readouterr().err
    assert not out.exists()


def alive_in_group(group):
    """Return the command lines of a group's processes, without those that have ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            # Behind the name in parentheses: state, parent, group.
            state, _, number = (path / "stat").read_text().rpartition(")")[2].split()[:3]
            if int(number) == group and state != "Z":
                found.append((path / "cmdline").read_text())
    return found


def test_main_keeps_what_is_done_when_interrupted(study_file, tmp_path):
    out = tmp_path / "out"
    arguments = ["--study", str(study_file()), "--out", str(out), "--runs", "2000"]
    # A job in the background of a script ignores SIGINT, and so would what it starts.
    script = f"""
        import signal, sys
        from phd_jdtc_ros.tools.monte_carlo import main
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.exit(main({[*arguments, "--workers", "1"]!r}))
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60.0
    while not list(out.glob("parts/*.csv.gz")) and time.monotonic() < deadline:
        time.sleep(0.1)
    # A keyboard sends the signal to the workers too.
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)

    assert process.returncode == 130
    assert errors.decode().strip() == "monte_carlo: interrupted"
    assert list(out.glob("parts/*.csv.gz"))
    deadline = time.monotonic() + 10.0
    while alive_in_group(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert alive_in_group(process.pid) == []


@pytest.mark.usefixtures("no_pictures")
def test_main_runs_on_dask(cluster, start):
    status, out = start("--dask", cluster, "--variant", "corrected")
    assert status == 0
    assert {row["seed"] for row in rows_of(out)} == {"1000", "1001"}


def test_main_refuses_a_dask_address_that_does_not_answer(start, monkeypatch, capsys):
    pytest.importorskip("distributed")
    monkeypatch.setattr(study_tasks, "DASK_TIMEOUT_S", 1)
    assert start("--dask", "tcp://127.0.0.1:9")[0] == 2
    assert "--dask: 'tcp://127.0.0.1:9' given" in capsys.readouterr().err
