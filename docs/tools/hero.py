"""Draws the README's first picture: detections of twenty scans in grey, tracks over them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.record import Record
from phd_jdtc_ros.report.style import GREY, INK, class_colour

SCANS = 20
# Every second scan makes an image, so that the file stays small.
STEP = 2
FRAME_MS, LAST_MS = 140, 4000
SIZE_IN, DPI = (8.0, 5.8), 110
COLOURS = 48
KM = 1e-3


def write(bag: Path, path: Path) -> None:
    """Write a demo's bag as an animated GIF, in the colours of its last image."""
    images = list(_frames(load.record(bag, resolve(bag_parameters.read(bag) or {}, SystemPlane))))
    palette = images[-1].quantize(COLOURS)
    first, *others = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    duration = [*[FRAME_MS] * len(others), LAST_MS]
    first.save(path, save_all=True, append_images=others, duration=duration, loop=0)


def _frames(record: Record) -> Iterator[Image.Image]:
    stamps = [estimates.stamp_ns for estimates in record.smoothed]
    for index in range((len(stamps) - 1) % STEP, len(stamps), STEP):
        figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
        axes = figure.add_subplot()
        axes.set(xlim=(-15.5, 15.5), ylim=(-11.0, 11.0), xlabel="km east", ylabel="km north")
        axes.set(xticks=range(-15, 16, 5), yticks=range(-10, 11, 5), aspect="equal")
        axes.spines[["top", "right"]].set_visible(False)
        _title(axes, record, (stamps[index] - stamps[0]) / 1e9)
        _detections(axes, record, stamps[max(index - SCANS + 1, 0)], stamps[index])
        _tracks(axes, record, index)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def _title(axes: Axes, record: Record, time_s: float) -> None:
    """Write what the colours mean above the map, in these colours."""
    words = [(0.0, f"{time_s:.0f} s", INK), (0.12, f"● detections of {SCANS} scans", GREY)]
    words += [
        (0.46 + 0.25 * k, f"● tracks, {record.sets.class_title(k)}", class_colour(k))
        for k in range(record.classes)
    ]
    for place, text, colour in words:
        axes.text(place, 1.02, text, transform=axes.transAxes, color=colour, fontsize=12)


def _detections(axes: Axes, record: Record, first_ns: int, last_ns: int) -> None:
    shown = [plot.position for plot in record.plots if first_ns <= plot.stamp_ns <= last_ns]
    axes.plot(*(KM * np.concatenate(shown).T), "o", color=GREY, markersize=2.6, markeredgewidth=0)


def _tracks(axes: Axes, record: Record, index: int) -> None:
    """Draw each track up to a scan as a line, with its number at the end."""
    rows: dict[int, list[tuple[int, float, float]]] = {}
    for estimates in record.smoothed[: index + 1]:
        place = (KM * estimates.position).tolist()
        for label, k, (x, y) in zip(
            estimates.track_id.tolist(), estimates.class_id.tolist(), place, strict=True
        ):
            rows.setdefault(label, []).append((k, x, y))
    for label, points in rows.items():
        colour = class_colour(points[-1][0])
        _, x, y = zip(*points, strict=True)
        axes.plot(x, y, color=colour, linewidth=2.6, solid_capstyle="round", zorder=3)
        axes.plot(x[-1], y[-1], "o", color=colour, markersize=13, markeredgecolor="white", zorder=4)
        axes.text(
            x[-1], y[-1], str(label), color="white", fontsize=10, fontweight="bold",
            ha="center", va="center", zorder=5,
        )  # fmt: skip
