"""Sensors: place, measurement, noise and coverage; and one report as the update sees it.

::

    sensor                               base class of all kinds
    polar_radar, spatial_radar, position the kinds
    visibility                           field of view, and p_D and clutter there
    view                                 a report, with what the factors expect of it
    of_gaussians                         expected measurements and gates of targets
    gaussians                            places and heights of targets born at detections
    point_gate                           gates around particles and other points
    polar_geometry, site, wgs84          range and azimuth, in the plane and on the earth
    range_rate, bias                     measured motion; constant errors
"""
