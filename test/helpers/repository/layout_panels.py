"""The shipped layouts of Foxglove and Lichtblick, and their panels."""

import json
from pathlib import Path

FOLDER = Path(__file__).parents[3] / "foxglove"
LAYOUTS = {path.stem: json.loads(path.read_text()) for path in FOLDER.glob("*.json")}


def panels(name, kind):
    """Return the panels of a kind of a layout."""
    configured = LAYOUTS[name]["configById"]
    return [panel for key, panel in configured.items() if key.startswith(f"{kind}!")]
