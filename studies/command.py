"""The studies by name, and all of them at once."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO

from phd_jdtc_ros.exit_status import FAILED, INTERRUPTED, OK, ArgumentParser
from phd_jdtc_ros.quoting import short
from phd_jdtc_ros.tools import monte_carlo

from . import peers, runner
from .autoferry import bags

# Module and name of each study. Studies are imported on demand, because some need Stone Soup.
STUDIES = {
    "madap": "madap.STUDY",
    "registration": "registration.STUDY",
    "handover": "handover.STUDY",
    "hours": "hours.study.STUDY",
    "hour_of_bag": "hours.study.OF_BAG",
    "autoferry": "autoferry.study.STUDY",
    "misspecified": "misspecified.STUDY",
    "changed_radars": "changed_radars.STUDY",
    "calibration": "calibration.study.STUDY",
    "hard_traffic": "hard_traffic.STUDY",
    "new_scenes": "new_scenes.study.STUDY",
    "tuning_truth": "calibration.tuning_truth.STUDY",
    "league": "league.STUDY",
    "conflicts": "conflicts.STUDY",
    "self_reports": "reports.harbours.STUDY",
    "aircraft_reports": "reports.aircraft.STUDY",
    "space": "space.STUDY",
    "positions": "positions.STUDY",
}
# Studies that run one after the other in a second process, in parallel to the Monte Carlo study.
REST = (
    *("madap", "registration", "handover", "hours"),
    *("misspecified", "changed_radars", "calibration"),
)
RUNS = 50


def study_of(name: str) -> runner.Study:
    """Import a study by its name in `STUDIES`; others stay unloaded."""
    module, _, attribute = STUDIES[name].rpartition(".")
    found: runner.Study = getattr(importlib.import_module(f"studies.{module}"), attribute)
    return found


def main(argv: Sequence[str]) -> int:
    """Run the study that the first argument names, with the others."""
    name, *rest = argv or ("--help",)
    if name in STUDIES:
        return runner.run(study_of(name), rest)
    if name in COMMANDS:
        return COMMANDS[name](rest)
    asked = name in ("-h", "--help")
    if not asked:
        print(short(f"unknown study {name!r}"), file=sys.stderr)
    usage = f"usage: python -m studies NAME [ARGUMENTS]; NAME: {', '.join([*COMMANDS, *STUDIES])}"
    print(usage, file=sys.stdout if asked else sys.stderr)
    return 0 if asked else 2


def _arguments(name: str, purpose: str | None, argv: Sequence[str]) -> argparse.Namespace:
    parser = ArgumentParser(f"studies {name}", description=purpose)
    if name == "all":
        parser.add_argument("--runs", type=int, default=RUNS, help="of monte_carlo (%(default)s)")
    parser.add_argument("--out", type=Path, default=runner.OUT, help="%(default)s")
    return parser.parse_args(argv)


def run_rest(argv: Sequence[str]) -> int:
    """Run the studies that join the Monte Carlo study, one after the other."""
    out = _arguments("rest", run_rest.__doc__, argv).out
    status = OK
    for name in REST:
        status = max(status, runner.run(study_of(name), ["--out", str(out)]))
        if status == INTERRUPTED:
            break
    return status


def run_all(argv: Sequence[str]) -> int:
    """Run the Monte Carlo study and beside it the others, so that no processor waits."""
    arguments = _arguments("all", run_all.__doc__, argv)
    out: Path = arguments.out
    for name in REST:
        (out / f"{name}.json").unlink(missing_ok=True)
    with tempfile.TemporaryFile("w+") as text, _beside(out, text) as rest:
        given = ["--runs", str(arguments.runs), "--out", str(out)]
        status = monte_carlo.main(given, lambda: int(rest.poll() is None), peers.KINDS)
        if status == INTERRUPTED:
            return status
        status = max(status, OK if rest.wait() == OK else FAILED)
        text.seek(0)
        sys.stdout.write(text.read())
    # The Monte Carlo study has written its summary since.
    for name in REST:
        path = out / f"{name}.json"
        if path.exists():
            runner.join(out, study_of(name), json.loads(path.read_text(encoding="utf-8")))
    return status


@contextmanager
def _beside(out: Path, text: IO[str]) -> Iterator[subprocess.Popen[str]]:
    """Run the rest in a process that ends with the block at the latest; print into `text`."""
    columns = str(shutil.get_terminal_size().columns)
    process = subprocess.Popen(
        [sys.executable, "-m", "studies", "rest", "--out", str(out)],
        env={**os.environ, "COLUMNS": columns},
        stdout=text,
        text=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "all": run_all,
    "rest": run_rest,
    "monte_carlo": partial(monte_carlo.main, kinds=peers.KINDS),
    "autoferry_bags": bags.main,
}
