"""Twelve scenes on which nothing was tuned, for this tracker and another one that is told as much.

::

    traffic     random targets and radars of each scene, and what a user knows of them
      |
    study       the tracker with true and with learned radars, beside `peers.integrated`
"""
