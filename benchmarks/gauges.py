"""Gauges of the code's structure, and the limits that they must keep.

``python -m benchmarks.gauges`` prints each gauge beside its limit, and ends with 1 if one exceeds
it. A limit is what was reached last: whoever gets below it lowers it. Only a new capability raises
one, by what it needs; the last ones were reports of ships and aircraft, and their decoders, heights
and tilted arrays in space, the law of clutter over range, conflicts and zones, manual work, in
replays too, the live picture, the trackers that share a track, the parameters of receivers of
reports, which are listed now, the areas of clouds, climb rates and moving platforms in space,
trackers of self-reports alone, biases of radars that reports show, polygons for the areas of
clouds, and more kinds of damaged and foreign recordings that are named.

A scan's path is traced by a profiler while one scan of two radars passes `Tracker.update`. A move
is a step from one file of the project to another, and a return is a move to a file that the scan
has been in before. Compiled functions count as a part of their caller.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import sparse

from phd_jdtc_ros import Tracker, simulate

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("phd_jdtc_ros", "msg_adapters")
# Rooms of the models of the world, which others should know by one interface.
WORLD = (
    "phd_jdtc_ros.core.factors",
    "phd_jdtc_ros.core.factors.transponder",
    "phd_jdtc_ros.core.factors.recent_looks",
    "phd_jdtc_ros.core.models.amplitude_model",
)
MANY = 9  # Number of parameters from which a function has too many
WARM_SCANS = 12  # Scans before the traced one

LIMITS: Mapping[str, float] = {
    "lines of the product": 78_855,
    "files of the product": 417,
    "declared parameters": 148,
    "constants of modules per 1,000 lines": 11.9,
    f"functions with {MANY} parameters or more": 1,
    "calls like f(*(a, b), c)": 0,
    "imports of models of the world": 18,
    "public members of Sensor": 29,
    "circles of imports": 0,
    "files that a scan enters": 74,
    "Python calls in a scan": 1_003,
    "returns in a scan": 876,
}


@dataclass(frozen=True)
class Module:
    """A tracked source file of the product."""

    name: str  # Dotted
    path: Path
    text: str
    tree: ast.Module

    @property
    def nodes(self) -> Iterator[ast.AST]:
        """All nodes of its syntax tree."""
        return ast.walk(self.tree)

    def imported(self, names: Iterable[str]) -> set[str]:
        """Return those of the named modules that it imports, anywhere in its text."""
        known, found = frozenset(names), set()
        for imported in self._imported_names():
            module = imported
            while module and module not in known:  # A name in a module is none.
                module = module.rpartition(".")[0]
            found.add(module)
        return found - {"", self.name}

    def _imported_names(self) -> Iterator[str]:
        parts = self.name.split(".")
        package = parts if self.path.name == "__init__.py" else parts[:-1]
        for node in self.nodes:
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                above = package[: len(package) - node.level + 1] if node.level else []
                base = [*above, *([node.module] if node.module else [])]
                yield from (".".join([*base, alias.name]) for alias in node.names)


def modules() -> list[Module]:
    """Return the tracked modules of the product."""
    command = ["git", "ls-files", *PRODUCT]
    listed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    found = []
    for line in listed.splitlines():
        path = Path(line)
        if path.suffix == ".py" and (ROOT / path).exists():
            name = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
            text = (ROOT / path).read_text()
            found.append(Module(name, path, text, ast.parse(text)))
    return found


def count_sources(product: list[Module]) -> dict[str, float]:
    """Return the gauges of the text."""
    names = [module.name for module in product]
    imports = {module.name: module.imported(names) for module in product}
    lines = sum(len(module.text.splitlines()) for module in product)
    functions = [
        node
        for module in product
        for node in module.nodes
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    calls = [node for module in product for node in module.nodes if isinstance(node, ast.Call)]
    world = {name for name in names if name.startswith(WORLD)}
    page = (ROOT / "docs" / "parameters.md").read_text()
    constants = sum(len(_constants(module.tree)) for module in product)
    return {
        "lines of the product": lines,
        "files of the product": len(product),
        "declared parameters": len(re.findall(r"^\| `", page, re.MULTILINE)),
        "constants of modules per 1,000 lines": round(1e3 * constants / lines, 1),
        f"functions with {MANY} parameters or more": sum(
            _parameter_count(function) >= MANY for function in functions
        ),
        "calls like f(*(a, b), c)": sum(map(_splices_tuple, calls)),
        "imports of models of the world": sum(
            len(found & world) for name, found in imports.items() if name not in world
        ),
        "public members of Sensor": len(_public_members(product)),
        "circles of imports": _count_circles(imports),
    }


def _constants(tree: ast.Module) -> list[str]:
    """Return the names of the constants of a module."""
    targets: list[ast.expr] = []
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets += node.targets
        elif isinstance(node, ast.AnnAssign):
            targets.append(node.target)
    names = [target.id for target in targets if isinstance(target, ast.Name)]
    return [name for name in names if re.fullmatch(r"_?[A-Z][A-Z0-9_]+", name)]


def _parameter_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the number of parameters besides `self`, `cls` and those after a star."""
    given = function.args
    named = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len(named) - (named[:1] in (["self"], ["cls"]))


def _splices_tuple(call: ast.Call) -> bool:
    """Return whether a call unpacks a tuple that it writes out itself."""
    return any(isinstance(a, ast.Starred) and isinstance(a.value, ast.Tuple) for a in call.args)


def _public_members(product: Iterable[Module]) -> set[str]:
    """Return the names of the public fields and methods of the class `Sensor`."""
    members = set()
    for module in product:
        for node in module.tree.body if module.name.endswith("sensors.sensor") else ():
            if isinstance(node, ast.ClassDef) and node.name == "Sensor":
                for item in node.body:
                    if isinstance(item, ast.FunctionDef):
                        members.add(item.name)
                    elif isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                        members.add(item.target.id)
    return {name for name in members if not name.startswith("_")}


def _count_circles(imports: Mapping[str, set[str]]) -> int:
    """Return the number of groups of modules that import each other."""
    index = {name: place for place, name in enumerate(imports)}
    arrows = [(index[name], index[other]) for name, found in imports.items() for other in found]
    row, column = np.array(arrows, dtype=np.int64).reshape(-1, 2).T
    shape = len(index), len(index)
    graph = sparse.csr_array((np.ones(len(row)), (row, column)), shape=shape)
    _, group = sparse.csgraph.connected_components(graph, connection="strong")
    return sum(size > 1 for size in Counter(group.tolist()).values())


def trace_scan() -> Trace:
    """Return the path of one scan."""
    run = simulate(seed=1)
    tracker, table = Tracker(dict(run.parameters) | {"engine": "gaussian"}), run.detections
    columns = {
        name: np.asarray(table[name])
        for name in (table.dtype.names or () if isinstance(table, np.ndarray) else table)
    }
    times, radars = columns.pop("time"), columns.pop("radar")

    def update(stamp_s: float) -> None:
        for radar in sorted(set(radars.tolist())):
            chosen = (times == stamp_s) & (radars == radar)
            report = {name: column[chosen] for name, column in columns.items()}
            tracker.update(stamp_s, report, radar=radar)

    stamps = np.unique(times).tolist()
    for stamp_s in stamps[:WARM_SCANS]:
        update(stamp_s)
    trace = Trace()
    sys.setprofile(trace)
    update(stamps[WARM_SCANS])
    sys.setprofile(None)
    return trace


class Trace:
    """Notes the files of the product that calls and returns of functions pass."""

    def __init__(self) -> None:
        self.path: list[str] = []  # Consecutive files differ
        self.calls = 0

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """Note a call or a return, as a profiler."""
        inside = _is_product(frame)
        if event == "call" and inside:
            self.calls += 1
            self._enter(frame)
        elif event == "return" and inside:
            caller = frame.f_back
            while caller is not None and not _is_product(caller):
                caller = caller.f_back
            if caller is not None:
                self._enter(caller)

    @property
    def figures(self) -> dict[str, float]:
        """The gauges of the path."""
        entered = set(self.path)
        return {
            "files that a scan enters": len(entered),
            "Python calls in a scan": self.calls,
            "returns in a scan": len(self.path) - len(entered),
        }

    def _enter(self, frame: FrameType) -> None:
        name = frame.f_code.co_filename
        if self.path[-1:] != [name]:
            self.path.append(name)


def _is_product(frame: FrameType) -> bool:
    return frame.f_code.co_filename.startswith(tuple(f"{ROOT / folder}/" for folder in PRODUCT))


def main() -> int:
    """Print the gauges; return 1 if one exceeds its limit."""
    figures = count_sources(modules()) | trace_scan().figures
    table = Table("gauge", box=None, pad_edge=False)
    for title in ("now", "at most"):
        table.add_column(title, justify="right")
    table.add_column("")
    exceeded = [name for name, figure in figures.items() if figure > LIMITS[name]]
    for name, figure in figures.items():
        remark = "too much" if name in exceeded else ""
        if figure < LIMITS[name]:
            remark = "its limit can be lowered"
        table.add_row(name, f"{figure:,}", f"{LIMITS[name]:,}", remark)
    Console(highlight=False).print(table)
    return 1 if exceeded else 0


if __name__ == "__main__":
    sys.exit(main())
