"""EUROCONTROL's ASTERIX: surveillance data as bytes, in and out. No ROS.

In: `framing` (recordings; `pcap`) gives datagrams, `blocks` their data blocks, `records` where the
items of a record are, `messages` what they say. `assembly` makes sectors of plots, and `slices`
slices of time where no crossing tells sectors, with times from `clocks`; `plot_stream` is the whole
path, for several radars.

Out: `encoding` packs items into records and blocks, `plots_out` writes CAT048 and CAT034, and
`tracks_out` CAT062 and CAT065.

What items a category has, in which order and how long they are, comes from libasterix
(`specification`).
"""
