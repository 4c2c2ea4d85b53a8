"""Finds the package's data files, in the checkout or in the installed package."""

from __future__ import annotations

import os
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.quoting import short

PACKAGE = "phd_jdtc_ros"
SHARE = Path("share", PACKAGE)
SCENARIOS = Path("config", "scenarios")
# The name of the reference scenario's bag.
DEFAULT_BAG = "paper_scenario"
# The bags of profiles that are not for the reference scenario.
PROFILE_BAGS = {
    "air_traffic": "two_approach_radars",
    "autoferry": "autoferry_2",
    "automotive": "automotive",
    "automotive_4d": "cars_4d",
    "drone": "drones",
    "harbour": "harbour_ais",
    "marine": "coastal",
    "own_ship": "coastal_ship",
}
# The c of OSPA and GOSPA, metres, in bags whose targets are much nearer to each other than usual.
BAG_CUTOFFS = {
    **{"autoferry_2": 50.0, "automotive": 20.0, "cars_4d": 20.0, "drones": 30.0},
    **{"coastal": 200.0, "coastal_ship": 200.0, "harbour_ais": 200.0},
}
# The environment variables that name the profiles' file for Fast DDS 2 and Fast DDS 3.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def find(relative: Path) -> Path:
    """Return the path of a file or directory; `relative` is its path in the checkout.

    It is looked for in the working directory, the checkout that the package is imported from, the
    ``share`` directory beside an installed package (of a prefix, a virtual environment or a pip
    target), and in the ament index. If it is nowhere, `relative` is returned.
    """
    home = Path(__file__).resolve().parents[1]
    places = [Path(), home]
    places += [base / SHARE for base in (home, *home.parents)]
    places += [Path(sysconfig.get_path("data")) / SHARE, Path(sys.prefix) / SHARE]
    for place in places:
        if os.path.exists(place / relative):
            return place / relative
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(PACKAGE)) / relative
    # ROS or the package is not installed, or no workspace is sourced.
    except (ImportError, LookupError, OSError):
        return relative


def bag(given: str | Path) -> Path:
    """Return the path of a bag, given by its path or a shipped name, or raise `BagError`."""
    path = Path(given)
    # For names that are too long pathlib raises, and os.path answers.
    if os.path.exists(path) or len(path.parts) != 1:
        return path
    shipped = find(Path("bags") / path)
    if not os.path.isdir(shipped):
        others = find(Path("bags") / DEFAULT_BAG).parent.glob("*/metadata.yaml")
        raise _missing(str(path), "bag", [entry.parent.name for entry in others])
    return shipped


def profile(name: str) -> tuple[Path, str]:
    """Return a shipped profile's file and the name of its bag, or raise `BagError`."""
    path = find(Path("config") / f"{name}.yaml")
    if Path(name).name != name or not os.path.exists(path):
        others = find(Path("config") / "defaults.yaml").parent.glob("*.yaml")
        raise _missing(name, "profile", [entry.stem for entry in others])
    return path, PROFILE_BAGS.get(name, DEFAULT_BAG)


def scenario(given: str | os.PathLike[str]) -> Path:
    """Return the path of a scenario, given by its path or a shipped name."""
    path = Path(given)
    shipped = find(SCENARIOS / f"{path}.yaml")
    return shipped if len(path.parts) == 1 and os.path.isfile(shipped) else path


def _missing(name: str, what: str, shipped: Iterable[str]) -> BagError:
    listed = ", ".join(sorted(shipped)) or "not found"
    return BagError(f"{short(name)}: no such {what}; those shipped are {listed}")


def isolation() -> dict[str, str]:
    """Return the environment variables that limit Fast DDS to the loopback interface.

    Empty if the user has chosen a profile, which then stays in force.
    """
    profile = find(Path("config/dds/localhost_only.xml"))
    chosen = [name for name in PROFILE_VARIABLES if name in os.environ]
    if chosen or not profile.exists():
        return {}
    return dict.fromkeys(PROFILE_VARIABLES, str(profile.resolve()))
