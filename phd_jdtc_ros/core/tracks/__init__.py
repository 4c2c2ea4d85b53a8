"""Tracks of a filter's targets: labels, track numbers, confirmation and reporting.

::

    confirmation         tentative, confirmed, coasting, no longer reported
    reporting_rule       the thresholds of this
    common_stamp         estimates of sectors at one stamp
    track_numbers        labels to numbers; the same one for an address that returns
    renumbering          the same numbers after scans were processed again
    manual, region       what operators do; where this tracker reports

Tracks without an address are never merged: in the association they compete for each detection.
"""
