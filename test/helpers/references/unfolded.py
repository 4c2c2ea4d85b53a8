"""Reads the packed columns of a page, as its script does."""

import base64
import gzip

import numpy as np


def columns_of(text, index):
    """Return the columns by name of the text and the index of `Columns`."""
    data, offset, found = gzip.decompress(base64.b64decode(text)), 0, {}
    for name, count in index:
        planes = np.frombuffer(data, np.uint8, 4 * count, offset).reshape(4, count)
        folded = (planes.T.astype(np.int64) << (8 * np.arange(4))).sum(axis=1)
        found[name] = np.cumsum((folded >> 1) ^ -(folded & 1))
        offset += 4 * count
    assert offset == len(data)
    return found


def rows_of(picture, group):
    """Return a group's rows: number, frame, place in metres, and its other columns by name."""
    columns = columns_of(picture.columns.text(), picture.columns.index)
    mine = {k.removeprefix(f"{group}."): v for k, v in columns.items() if k.startswith(f"{group}.")}
    if "number" in mine:
        counts = np.diff([*mine.pop("start"), len(mine["frame"])])
        mine["number"] = np.repeat(mine["number"], counts)
    places = np.stack([mine.pop("x"), mine.pop("y")], axis=1) * picture.header["quantum"]
    return {**mine, "place": places + picture.header["corner"]}
