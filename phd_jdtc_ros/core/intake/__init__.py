"""From reports to scans.

::

    input_checks, clocks         signs of a wrong configuration; wrong clocks
    revolutions, antenna         revolutions cut into slices, by the antenna's motion
    sectors                      the coverage of a slice
    transforms, poses            poses of moving platforms, from ``/tf`` or a topic
    posed_reports                reports wait for their poses
    scans                        reports with one stamp are a scan; what comes after it is late
    out_of_sequence              late reports are dropped, or later scans processed again
    revolution_history           late sectors are cut in again
"""
