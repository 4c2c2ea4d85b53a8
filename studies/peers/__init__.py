"""Other trackers on the same detections: Stone Soup's GM-PHD, nearest neighbour (GNN) and JPDA.

`plot_kalman`, for turning radars, and `integrated`, a JIPDA tracker with several motions and a
smoother, are independent of Stone Soup. The rest of this page describes the other peers.

Stone Soup (https://stonesoup.rtfd.io, PyPI ``stonesoup``) is an optional extra: this package can be
imported without it, and the peers' error message says what to install. Its predictors, updaters,
hypothesisers, associators, initiators, reducer and smoother do the work; this package combines
them, supplies the scenario and collects the estimates. The data flow, with the module of each
step::

    SimulatedRun
      |  if loud: drop low amplitudes             threshold
      |  convert to Stone Soup's types            problem, conversion
    scans, birth places, predictor, updater
      |  gm_phd, gm_phd_loud                      mixture_phd
      |  gnn, gnn_loud, gnn_anywhere              track_based, management
      |  jpda, jpda_loud                          track_based, management
    Tracks: positions of every scan, by lag

`soup` lists the parts of Stone Soup that are used, `settings` the tuned values, and `kinds` has the
peers as kinds of tracker in a Monte Carlo study.

The peers get the same information as this package's tracker: position and noise of the radars, the
clutter density, and the birth terms and survival probability of the reference configuration. Their
motion model is nearly constant velocity with the reference's noise density; the scenario's targets
fly straight. Both radars of a stamp update in sequence.

They get no classes or amplitudes, which Stone Soup's trackers do not use. The probability of
detection is the mean over the classes, and every estimate has class 0, so that only the scores of
the set ``all`` are meaningful. The ``_loud`` variants use detections of high amplitude only, and
show the value of amplitudes to such a tracker. `gnn_anywhere` starts tracks at any detection, and
shows the value of known birth places.

Notes
-----
Settings were chosen on the reference scenario by the mean OSPA (p = 2, c = 1000 m) of the filter
and, for GNN, of the smoother at lag 5. For the GM-PHD seeds 1000 to 1003 were used, for the others
1000 to 1005, 2000 to 2009 and 3000 to 3019, because the best settings of six runs lose a target
permanently in one run of ten:

========  ========================================================================================
tracker   tried
========  ========================================================================================
GM-PHD    merge 0.25 to 16 (2 and below split targets, 6 and above fuse the two parallel ones),
          gate 4 and 5, pruning 1e-5 and 1e-3, extraction 0.3 to 0.6, merging once per scan instead
          of once per radar, merging without Stone Soup's limit of the weight to 1: no alternative
          is better than the chosen settings by more than a few per cent
GNN       gate 3 to 5, 2 to 6 detections to confirm, deletion after 2 to 6 missed looks, of
          tentative tracks after 1 to 3, tracks started at the birth places or anywhere, reports of
          tracks that no radar detected, detection thresholds 4.5, 5 and 6
JPDA      as GNN; good settings for one are good for the other
========  ========================================================================================

Three things differ from plain Stone Soup, each to the peers' advantage:

- Differences of Stone Soup's `Bearing` wrap in gates, updates and association probabilities, but
  its PHD updater evaluates the likelihood of plain numbers. For the GM-PHD, each hypothesis
  therefore shifts its detection's bearing by full turns to be nearest to the predicted bearing.
- Its deleters count stamps, so they cannot distinguish one missed look from two at the same stamp;
  `LooksMissed` counts looks.
- Its mixture tracker treats every detection that is more probable than a miss as associated, so
  with JPDA a target near a track never starts a track of its own (mean OSPA above 220 m instead of
  130). Here a track claims only its most probable detection.
"""

from .kinds import KINDS, PEERS
from .mixture_phd import gm_phd
from .track_based import gnn, jpda

__all__ = ["KINDS", "PEERS", "gm_phd", "gnn", "jpda"]
