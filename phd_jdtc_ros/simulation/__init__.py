"""Scenarios with known truth, and radars' simulated reports of them.

::

    document (YAML, read elsewhere)
      |  check                               scenario_file, checked
      |  many targets by one block           traffic
    Scenario: targets, turns, radars         scenario, platform
      |  detect, with clutter                simulate, clutter
    (Truth, Scan) by stamp
      |  where antennas turn                 looks, turning_antenna
    Report by turn or sector, with times
"""
