"""Mutation tests of the association, the correctors and the smoother, into out/mutants.

mutmut changes one operator, number, name or argument at a time, and runs the unit tests of the
module that it changed: a mutant that passes them all survives. What numba compiles is
interpreted here, because a mutant of a compiled one would be compiled for every test.

A mutant that no test can distinguish from the original is equivalent, and is listed with the
reason in ``mutants.yaml``, which also has the parts. The share is that of the others, and the goal
is for each part. Names of parts may be given.
"""

import ast
import difflib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
OUT = ROOT / "out" / "mutants"
CORE = "phd_jdtc_ros/core"
# Paths that the tests import and read.
COPIED = ("phd_jdtc_ros", "msg_adapters", "robustness", "config", "test", "pyproject.toml")
GOAL = 0.9
# Time limit of each part; mutants that are left by then count as not killed.
LIMIT_S = 900.0
CHILDREN = 2
NOT_KILLED = ("survived", "no tests", "not checked", "suspicious", "skipped")


@dataclass(frozen=True)
class Part:
    """Modules, and the tests that are to kill their mutants; see ``mutants.yaml``."""

    modules: list[str]
    tests: list[str]
    without: tuple[str, ...] = ()


DOCUMENT = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
PARTS = {name: Part(**part) for name, part in DOCUMENT["parts"].items()}


@dataclass
class Result:
    """How many mutants of a part were killed, and the changes that were not."""

    mutants: int = 0
    killed: int = 0
    equivalent: int = 0
    survivors: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def share(self) -> float:
        """Return the share of the mutants that are not equivalent."""
        return self.killed / max(self.mutants - self.equivalent, 1)


def configuration(part):
    """Return the section of pyproject.toml for mutmut."""
    left_out = " and ".join(f"not {name}" for name in ("numba", *part.without))
    options = {
        "source_paths": ["phd_jdtc_ros"],
        "only_mutate": [f"{CORE}/{module}" for module in part.modules],
        "also_copy": ["msg_adapters", "robustness", "config"],
        "pytest_add_cli_args": ["-p", "no:cacheprovider", "-k", left_out],
        "pytest_add_cli_args_test_selection": [f"test/core/{name}" for name in part.tests],
    }
    lines = [f"{name} = {json.dumps(value)}" for name, value in options.items()]
    return "\n".join(["", "[tool.mutmut]", *lines, ""])


def mutate(name, part):
    """Run mutmut on a copy of the tree; return the status of each mutant, and the copy."""
    place = OUT / name.replace(" ", "_")
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    for entry in COPIED:
        copy = shutil.copytree if (ROOT / entry).is_dir() else shutil.copy
        copy(ROOT / entry, place / entry)
    with (place / "pyproject.toml").open("a") as file:
        file.write(configuration(part))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)  # They could lead to the original modules
    command = [sys.executable, "-m", "mutmut"]
    with (place / "mutmut.log").open("w") as log:
        run = subprocess.Popen(
            [*command, "run", "--max-children", str(CHILDREN)],
            cwd=place,
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        try:
            run.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            run.terminate()
            run.wait()
    show = [*command, "results", "--all", "true"]
    out = subprocess.run(
        show, check=False, cwd=place, env=environment, capture_output=True, text=True
    )
    pairs = [line.strip().rpartition(": ") for line in out.stdout.splitlines() if ": " in line]
    if not pairs:
        sys.exit(f"{name}: no mutants; see {place / 'mutmut.log'}")
    return {mutant: status for mutant, _, status in pairs}, place / "mutants"


def changes(mutants, tree):
    """Return the module and the changed lines of each mutant, as in a difference of files."""
    found, functions = {}, {}
    for mutant in mutants:
        module, _, function = mutant.rpartition(".")
        path = tree / f"{module.replace('.', '/')}.py"
        if path not in functions:
            text = path.read_text()
            functions[path] = {
                node.name: ast.unparse(node).splitlines()[1:]
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.FunctionDef)
            }
        original = functions[path][f"{function.rpartition('__mutmut_')[0]}__mutmut_orig"]
        lines = difflib.unified_diff(original, functions[path][function], lineterm="", n=0)
        change = "\n".join(
            f"{line[0]} {line[1:].strip()}"
            for line in lines
            if line[:3] not in ("---", "+++", "@@ ")
        )
        found[mutant] = str(path.relative_to(tree / CORE)), change
    return found


def known_equivalents():
    """Return the changes of lines that are known to be equivalent, by module and change."""
    return {
        (module, f"- {line}\n+ {mutant}")
        for module, reasons in DOCUMENT["equivalent"].items()
        for lines in reasons.values()
        for line, mutants in lines.items()
        for mutant in mutants
    }


def equivalent_anywhere(change):
    """Return whether a change is one that no test can distinguish in any module."""
    line, _, mutant = change.removeprefix("- ").partition("\n+ ")
    return any(
        line[: at.start()] + new + line[at.end() :] == mutant
        for changes in DOCUMENT["anywhere"].values()
        for old, new in changes.items()
        for at in re.finditer(re.escape(old), line)
    )


def judged(status, tree, equivalents):
    """Return the result of a part."""
    alive = [mutant for mutant, what in status.items() if what in NOT_KILLED]
    result = Result(len(status), len(status) - len(alive))
    for mutant, (module, change) in changes(alive, tree).items():
        if (module, change) in equivalents or equivalent_anywhere(change):
            result.equivalent += 1
        else:
            result.survivors.append(f"{mutant}: {status[mutant]}\n{change}")
    return result


def main(names):
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        sys.exit(f"{unknown[0]}: no such part; there are {', '.join(PARTS)}")
    equivalents, results = known_equivalents(), {}
    for name in names or PARTS:
        begin = time.monotonic()
        status, tree = mutate(name, PARTS[name])
        results[name] = judged(status, tree, equivalents)
        results[name].seconds = time.monotonic() - begin
        found = results[name]
        print(
            f"{name}: {found.killed} of {found.mutants - found.equivalent} mutants killed, "
            f"{found.share:.1%}; {found.equivalent} equivalent; {found.seconds:.0f} s",
            flush=True,
        )
    tested = sum(one.mutants - one.equivalent for one in results.values())
    share = sum(one.killed for one in results.values()) / tested
    short = [name for name, one in results.items() if one.share < GOAL]
    summary = {
        "share": share,
        "goal": GOAL,
        "reached": not short,
        "parts": {name: {**asdict(one), "share": one.share} for name, one in results.items()},
    }
    (OUT / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(
        f"all: {share:.1%} of {tested} mutants killed, goal {GOAL:.0%} of each part; "
        f"{OUT / 'summary.json'}"
    )
    return f"fewer: {', '.join(short)}" if short else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
