"""Neighbour search: finds the pairs of points that are close, without forming all pairs.

::

    particles and detections of a radar    gating: lists by cells of range and azimuth
    particles of two scans, any origin     sweep: sort and sweep over two coordinates
      |  candidate pairs                   candidates: expanded and tested chunk by chunk
    pairs within the radius
"""
