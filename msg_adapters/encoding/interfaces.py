"""Message types for bags: class, definition, type hash, and reproducible serialisation.

Definitions and hashes are read from the installed interface packages, as rosbag2 does, so they
match the running ROS.
"""

from __future__ import annotations

import importlib
import json
from functools import cache
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from . import RejectedMessageError, cdr

# Serialises messages reproducibly; `decode` is the inverse.
encode = cdr.encode


@cache
def message_class(type_name: str) -> Any:
    """Return the message class of a type name such as ``sensor_msgs/msg/PointCloud2``."""
    package, _, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def installed_class(type_name: str) -> Any:
    """Return the message class of a type name, or None if its package is not installed."""
    try:
        return message_class(type_name)
    except ImportError:
        return None


def type_name(message_type: Any) -> str:
    """Return the type name of a message class."""
    package = message_type.__module__.split(".")[0]
    return f"{package}/msg/{message_type.__name__}"


def _share_file(type_name: str, suffix: str) -> Path:
    """Return a file of a type in its package's share directory.

    Wheels and ROS installations both keep ``share`` beside the ``lib`` that contains the package.
    The ament index is not used, because the wheels do not set it up.
    """
    package, _, name = type_name.split("/")
    home = Path(importlib.import_module(package).__path__[0])
    relative = Path("share", package, "msg", name + suffix)
    for parent in home.parents:
        if (parent / relative).is_file():
            return parent / relative
    raise FileNotFoundError(f"{relative} is in none of the directories above {home}")


@cache
def type_hash(type_name: str) -> str:
    """Return the RIHS01 hash of a type."""
    description = json.loads(_share_file(type_name, ".json").read_text())
    hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
    return str(hashes[type_name])


@cache
def definition(type_name: str) -> str:
    """Return the definitions of a type and of all types that it contains, as ``ros2msg``."""
    separator = "=" * 80
    description = json.loads(_share_file(type_name, ".json").read_text())["type_description_msg"]
    nested = [entry["type_name"] for entry in description["referenced_type_descriptions"]]
    parts = [_share_file(type_name, ".msg").read_text()]
    for name in nested:
        package, _, short = name.split("/")
        parts.append(f"MSG: {package}/{short}\n{_share_file(name, '.msg').read_text()}")
    return f"\n{separator}\n".join(part.rstrip("\n") for part in parts) + "\n"


def decode(data: bytes, type_name: str) -> Any:
    """Deserialise a message of the given type from CDR bytes.

    Raise `RejectedMessageError`: ``schema`` if the bytes are not such a message.
    """
    try:
        return deserialize_message(data, message_class(type_name))
    except Exception as error:  # The middleware raises several types for foreign bytes
        raise RejectedMessageError("schema", f"not a {type_name}: {error}") from error
