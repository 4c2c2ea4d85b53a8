"""``python -m benchmarks.gate [COMMIT]``: compares the time of a step with a commit's.

Both sources track the same scans in turns, in processes of their own, by the public names alone, so
that the machine's speed affects both. What counts is the median over the rounds of the ratio.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from phd_jdtc_ros.threads import use_one_thread

ROOT = Path(__file__).parents[1]
ROUNDS = 7
LARGEST = 1.15
# The first pass compiles and fills the caches; what happens once in another does not count.
TIMED = """
import sys, time
from phd_jdtc_ros import Tracker, simulate
run, spent = simulate(seed=1), []
for _ in range(4):
    tracker = Tracker({**run.parameters, "engine": "gaussian"})
    begin = time.process_time()
    tracker.track(run.detections)
    spent.append(time.process_time() - begin)
print(min(spent[1:]))
"""


def seconds(source: Path) -> float:
    """Return the CPU time in which the source in a directory tracks the reference scenario."""
    done = subprocess.run(
        [sys.executable, "-c", TIMED],
        cwd=source,
        env={**os.environ, "PYTHONPATH": str(source)},
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout)


def ratio(now: Sequence[float], before: Sequence[float]) -> float:
    """Return the median over rounds of how many times longer it takes now."""
    return statistics.median(new / old for new, old in zip(now, before, strict=True))


def main(argv: Sequence[str]) -> int:
    """Compare with a commit, the last one by default; 1 if the tracker is slower."""
    parser = argparse.ArgumentParser("python -m benchmarks.gate", description=__doc__)
    parser.add_argument("commit", nargs="?", default="HEAD~1", help="the commit, %(default)s")
    commit = parser.parse_args(argv).commit
    use_one_thread()
    with tempfile.TemporaryDirectory() as directory:
        before, packed = Path(directory) / "before", Path(directory) / "before.tar"
        subprocess.run(["git", "-C", ROOT, "archive", "--output", packed, commit], check=True)
        shutil.unpack_archive(packed, before)
        rounds = [(seconds(ROOT), seconds(before)) for _ in range(ROUNDS)]
    found = ratio(*zip(*rounds, strict=True))
    print(f"{found:.2f} times the CPU time of {commit}, at most {LARGEST}")
    return int(found > LARGEST)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
