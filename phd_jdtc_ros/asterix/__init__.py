"""Reads and writes EUROCONTROL's ASTERIX surveillance data. No ROS.

Input: `transport` (recordings, captures, sockets) yields datagrams, `plot_stream` finds their
data blocks, and `records` decodes the records to `messages`. `assembly` groups plots into sectors
by the sector crossings, or into slices of time if a radar sends no crossings. `clocks` dates the
messages. `plot_stream` is the whole path for several radars.

Output: `writing.encoding` packs items into records and blocks, `writing.plots` writes CAT048 and
CAT034, and `writing.tracks` writes CAT062 and CAT065.

The items of a category, their order and their lengths come from libasterix (`specification`); an
item's length follows from its kind (`specification`).
"""
