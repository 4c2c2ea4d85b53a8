"""Joint detection, tracking and classification of targets with radars, live on ROS 2.

In Python, without ROS: `Tracker`, `simulate` and `evaluate`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phd_jdtc_ros.api.scores import evaluate, simulate
    from phd_jdtc_ros.api.tracker import Tracker

__all__ = ["Tracker", "__version__", "evaluate", "simulate"]
__version__ = "1.0.0"


def __getattr__(name: str) -> Any:
    """Import a public name."""
    # These are imported on first use, so that they do not delay the start of nodes.
    modules = {"Tracker": "tracker", "simulate": "scores", "evaluate": "scores"}
    if name not in modules:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.api.{modules[name]}"), name)
