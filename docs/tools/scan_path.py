"""Draws the path of one scan through the packages, as `benchmarks.gauges` traces it.

``python docs/tools/scan_path.py`` writes ``docs/images/scan_path.svg``: a row for each package in
the order in which the scan first enters it, and from left to right each move between two packages.
"""

from __future__ import annotations

import sys
from itertools import groupby, pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "images" / "scan_path.svg"
LEFT, RIGHT, TOP, ROW, WIDTH = 190, 90, 40, 24, 900


def package_of(file: str) -> str:
    """Return the package of a file, without the product's name."""
    parts = Path(file).relative_to(ROOT / "phd_jdtc_ros").with_suffix("").parts
    return ".".join(parts[:-1]) or parts[0]


def draw(path: list[str]) -> str:
    """Return the picture of a path of files."""
    files: dict[str, set[str]] = {}
    for file in path:
        files.setdefault(package_of(file), set()).add(file)
    stays = [package for package, _ in groupby(map(package_of, path))]
    row = {package: TOP + ROW * index for index, package in enumerate(files)}
    step, height = (WIDTH - LEFT - RIGHT) / len(stays), TOP + ROW * len(files)
    places = [(LEFT + step * index, row[package]) for index, package in enumerate(stays)]
    moves = "".join(f"M{x:.1f} {before}V{after}" for (_, before), (x, after) in pairwise(places))
    marks = "".join(f"M{x:.1f} {y}h{step:.1f}" for x, y in places)
    labels = "".join(
        f'<path class="row" d="M{LEFT} {y}H{WIDTH - RIGHT}"/>'
        f'<text x="{LEFT - 10}" y="{y + 4}" text-anchor="end">{package}</text>'
        f'<text class="small" x="{WIDTH - RIGHT + 10}" y="{y + 4}">{len(files[package])} files, '
        f"{stays.count(package)}</text>"
        for package, y in row.items()
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="13">\n'
        "<style>text { fill: #222222; } text.small { fill: #555555; font-size: 11px; } "
        "path { stroke: #e3e8ee; } path.moves { stroke: #b9d3e6; stroke-width: 0.5; } "
        "path.stays { stroke: #0072b2; stroke-width: 8; }</style>\n"
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>\n'
        f'<text class="small" x="{LEFT}" y="18">one scan of two radars: {len(stays)} stays in '
        f"{len(files)} packages, from left to right</text>\n"
        f'{labels}\n<path class="moves" d="{moves}"/><path class="stays" d="{marks}"/>\n</svg>\n'
    )


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    from benchmarks.gauges import trace_scan

    PICTURE.write_text(draw(trace_scan().path))
