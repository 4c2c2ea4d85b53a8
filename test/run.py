"""Run all tests: the live ones in several pytests, beside the others in two halves.

Live tests wait for other processes most of the time, so several take hardly longer than one. Each
pytest has a ROS domain of its own (see conftest.py), and one that crashes takes nothing else with
it. A pytest that was ended by a signal is run once again, with a notice: once in many runs the
native libraries of ROS crash where a test destroys its own node. Whatever is over makes place for
the next. Arguments go to every pytest. The last line is the sum of all of theirs, in pytest's
form, with the number of pytests that were run again.
"""

import os
import re
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from helpers.live.live_files import names_live_tests

ROOT = Path(__file__).parents[1]
# The halves of what is not live and three of what is live keep two processors busy, and so do
# five of these; more would only wait for one another.
AT_A_TIME = 5
# Files with nodes in pytest's own process, whose graph keeps them after their end: run apart from
# the others.
OWN_NODES = (
    "test/nodes/parameter_files/test_parameter_sections.py",
    "test/nodes/tracker/radars/test_poses_before_clouds.py",
)
# Number of pytests for the other live files, which begin at once: each spends 3 s on imports, and
# 4 s on the server of its nodes (see helpers/live/forked.py).
LIVE_PYTESTS = AT_A_TIME - 2
# Seconds that live files take beside others, where it is long, so that the sums of the pytests are
# about the same; `USUAL_S` is for all others.
SECONDS = {
    "test/robustness/test_live_faults.py": 95,
    "test/nodes/test_demo.py": 80,
    "test/nodes/asterix/test_asterix_bridge_node.py": 75,
    "test/nodes/test_asterix_demo.py": 45,
    "test/tools/test_installed.py": 45,
    "test/robustness/test_full_tracker.py": 35,
    "test/nodes/tracker/test_second_tracker.py": 30,
    "test/nodes/replay/test_replay_waits.py": 25,
    "test/nodes/tracker/test_tracker_diagnostics.py": 25,
    "test/robustness/test_isolation.py": 25,
}
USUAL_S = 8
# One of two halves that take as long as each other, some 300 s of CPU: what one takes longer is for
# one processor alone, because the live tests are over by then.
HALF = ("test/calibration", "test/core", "test/study")
# Some hundred processes import the same files: what one has compiled serves the others.
ENVIRONMENT = {name: os.environ[name] for name in os.environ if name != "PYTHONDONTWRITEBYTECODE"}
LIMIT_S = 2400.0
# The exit status of a pytest that has nothing to run.
NOTHING = 5
OUTCOMES = ("failed", "passed", "skipped", "xfailed", "xpassed", "error", "rerun")


def pytest(*arguments):
    command = [sys.executable, "-m", "pytest", *arguments]
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=ENVIRONMENT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return 1, f"{(error.stdout or b'').decode(errors='replace')}\nnot over in {LIMIT_S:g} s"
    return done.returncode, done.stdout


def live(arguments):
    """Run the live tests of files, once again after a crash; return as `pytest` does."""
    status, text = pytest("-m", "live", *arguments)
    if status < 0:
        names = " ".join(arguments)
        print(f"{names}: ended by signal {-status}, and run again\n{text}", flush=True)
        status, text = pytest("-m", "live", *arguments)
        # This text has the form of pytest's plugin; the last line is counted.
        *lines, last = text.rstrip().split("\n")
        text = "\n".join([*lines, f"1 rerun, {last}"])
    return status, text


def live_groups(arguments):
    """Return the arguments of each pytest of what is live."""
    if arguments:
        return [arguments]
    paths = sorted(path for path in (ROOT / "test").rglob("test_*.py") if names_live_tests(path))
    files = [str(path.relative_to(ROOT)) for path in paths]
    groups, sums = [[] for _ in range(LIVE_PYTESTS)], [0] * LIVE_PYTESTS
    for file in sorted(files, key=lambda file: -SECONDS.get(file, USUAL_S)):
        if file not in OWN_NODES:
            least = sums.index(min(sums))
            groups[least].append(file)
            sums[least] += SECONDS.get(file, USUAL_S)
    return [*groups, OWN_NODES]


def others(arguments):
    """Return the arguments of each pytest of what is not live, by its name."""
    if arguments:  # They may name files of both halves
        return {"all that is not live": arguments}
    return {
        "not live, the core, calibration and the Monte Carlo study": HALF,
        "not live, elsewhere": [f"--ignore={folder}" for folder in HALF],
    }


def counts(status, text):
    """Return how many tests had each outcome; a process that was cut off is an error."""
    last = text.rstrip().rpartition("\n")[2]
    found = Counter()
    for number, outcome in re.findall(r"(\d+) (\w+?)s?\b", last):
        if outcome in OUTCOMES:
            found[outcome] += int(number)
    if status not in (0, NOTHING) and not found["failed"] + found["error"]:
        found["error"] += 1
    return found


def report(name, status, text):
    """Return the summary of a run: its skips and its last line, or all if it failed."""
    if status not in (0, NOTHING):
        return f"{name}: exit status {status}\n{text}"
    *lines, last = text.rstrip().splitlines()
    skips = [line for line in lines if line.startswith("SKIPPED")]
    return "\n".join([*skips, f"{name}: {last.strip('= ')}"])


def summary(found, seconds):
    parts = ", ".join(f"{found[outcome]} {outcome}" for outcome in OUTCOMES if found[outcome])
    text = f" {parts or 'no tests ran'} in {seconds:.2f}s "
    return f"{text:=^80}"


def main(arguments):
    begin, found, failed = time.monotonic(), Counter(), False
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        # A live test does not wait for a tracker that compiles.
        compiling = [sys.executable, "-m", "phd_jdtc_ros", "compile_engines"]
        subprocess.run(compiling, cwd=ROOT, check=True)
        running = {
            pool.submit(pytest, "-m", "not live", *own): name
            for name, own in others(arguments).items()
        }
        for own in live_groups(arguments):
            running[pool.submit(live, own)] = " ".join(own)
        try:
            for run in as_completed(running):
                status, text = run.result()
                print(report(running[run], status, text), flush=True)
                found += counts(status, text)
                failed |= status not in (0, NOTHING)
        except KeyboardInterrupt:  # Those that run have been told too
            pool.shutdown(wait=False, cancel_futures=True)
            failed = True
    print(summary(found, time.monotonic() - begin))
    return int(failed or not found.total())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
