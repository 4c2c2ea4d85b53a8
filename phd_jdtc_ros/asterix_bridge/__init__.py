"""The ASTERIX bridge, for its node and its offline tool.

`configuration` has the parameters of a bridge and the stream of plots that it describes, `clouds`
turns reports of plots into clouds, and `tracks` the tracker's estimates into data blocks of tracks.
"""
