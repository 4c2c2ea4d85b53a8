# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stone Soup's trackers on the same detections: GM-PHD, global nearest neighbour, JPDA.

Stone Soup (https://stonesoup.rtfd.io, PyPI ``stonesoup``) is an optional extra: this package
imports without it, and the peers say what to install. Its predictors, updaters, hypothesisers,
associators, initiators, reducer and smoother do the work; here they are put together, told about
the scenario, and read out. A run's way through the package, with the module of each step::

    SimulatedRun
      |  for gnn_loud: drop weak detections       threshold
      |  in Stone Soup's terms                    problem, conversion
    scans, birth places, predictor, updater
      |  gm_phd                                   mixture_phd
      |  gnn, gnn_loud, gnn_anywhere              nearest_neighbour, tracks, management
      |  jpda                                     probabilistic, tracks, management
    Tracks: positions of every scan, by lag

The parts of Stone Soup are named in `soup`, the tuned values in `settings`.

The peers are told what the tracker of this package is told: place and noise of the radars, the
clutter density, and the birth terms and survival probability of the reference configuration. They
move targets at nearly constant velocity with the reference's noise density; the targets do fly
straight. Both radars are taken in sequence at one stamp.

They are not told classes or amplitudes, for which Stone Soup's trackers have no use. The
probability of detection is the mean of the classes', and every estimate carries class 0: only the
set ``all`` of their scores means anything. What amplitude is worth to such a tracker can be
seen with `gnn_loud`, which sees the strong detections alone, and what the birth places are worth
with `gnn_anywhere`, which starts tracks wherever detections are.

Notes
-----
Settings were chosen on the reference scenario by mean OSPA (p = 2, c = 1000 m) of the filter and,
for the nearest neighbour, of the smoother at lag 5; the GM-PHD's on seeds 1000 to 1003, the
others' on 1000 to 1005, 2000 to 2009 and 3000 to 3019, because settings that are best on six runs
lose a target for good in one run of ten:

========  ========================================================================================
tracker   tried
========  ========================================================================================
GM-PHD    merge 0.25 to 16 (2 and below split targets, 6 and above fuse the two parallel ones),
          gate 4 and 5, pruning 1e-5 and 1e-3, extraction 0.3 to 0.6, merging once a scan instead
          of once a radar, merging without Stone Soup's limit of the weight to 1: none better than
          these settings by more than a few per cent
GNN       gate 3 to 5, 2 to 6 detections to confirm, deletion after 2 to 6 looks missed, tentative
          tracks after 1 to 3, tracks started at the birth places or anywhere, reports of tracks
          that no radar saw, detection thresholds 4.5, 5 and 6
JPDA      as the nearest neighbour; what is good for one is good for the other
========  ========================================================================================

Three things differ from Stone Soup as it comes, each to the peers' advantage:

- Differences of Stone Soup's `Bearing` wrap in gates, updates and association probabilities, but
  its PHD updater takes the likelihood of plain numbers. For the GM-PHD every detection is moved,
  hypothesis by hypothesis, to the turn nearest to the predicted bearing.
- Its deleters count stamps, so they cannot tell one missed radar from two at the same stamp;
  `LooksMissed` counts looks.
- Its mixture tracker takes for associated every detection that is likelier than a miss, so with
  JPDA a target beside a track never starts one (mean OSPA above 220 m instead of 130). Here a track
  claims its most probable detection only.
"""

from .mixture_phd import gm_phd
from .nearest_neighbour import gnn, gnn_anywhere, gnn_loud
from .probabilistic import jpda

__all__ = ["gm_phd", "gnn", "gnn_anywhere", "gnn_loud", "jpda"]
