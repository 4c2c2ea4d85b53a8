"""Scenarios with known truth, and what radars report of them.

::

    document (YAML, read elsewhere)
      |  check                               scenario_file, checked
      |  many targets by one block           generators, traffic, geodesy
    Scenario: targets, turns, radars         scenario, flight, platform
      |  detect, with clutter                simulate, clutter_law, reflectors
    (Truth, Scan) by stamp
      |  where antennas turn                 sweep
    Report by turn or sector, with times
"""
