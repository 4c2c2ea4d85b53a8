"""Transponder data: identities and heights of targets, estimated separately from their states.

::

    labels, gates
      |  plots with false heights, projected at a target's height   reprojection
      |  range rates without the part of a known climb rate         climbs
    pairs of rows and detections
      |  likelihood of the identity and the height                  identity, height
      |  unique identities: of another target, or outside its gate  uniqueness
      |  replies of the targets, reflected to other places          reflections
    log factor of each pair, of clutter and of new targets          evidence
      |  (the association)
    probability of each pair
      |  beliefs about each label                                   records, history
    code, address, z, vz of estimates                               transponders

The update uses only `transponders.Transponders`. A belief belongs to a label and is independent of
how the engine represents the state. In space heights are measurements of the state, and `pressure`
is the difference of pressure altitudes from these.
"""

from .height import HeightModel
from .identity import ADDRESSES, CODES, IdentityModel
from .pressure import Pressure
from .records import AttributeModel

__all__ = ["ADDRESSES", "CODES", "AttributeModel", "HeightModel", "IdentityModel", "Pressure"]
