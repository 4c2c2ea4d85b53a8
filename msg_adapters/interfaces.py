# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a bag stores about message types: class, definition, type hash, reproducible bytes.

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

from .errors import RejectedMessageError

_SEPARATOR = "=" * 80


@cache
def message_class(type_name: str) -> Any:
    """Return the message class of a type name such as ``sensor_msgs/msg/PointCloud2``."""
    package, _, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


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
    """Return the definitions of a type and of all types it contains, as ``ros2msg``."""
    description = json.loads(_share_file(type_name, ".json").read_text())["type_description_msg"]
    nested = [entry["type_name"] for entry in description["referenced_type_descriptions"]]
    parts = [_share_file(type_name, ".msg").read_text()]
    for name in nested:
        package, _, short = name.split("/")
        parts.append(f"MSG: {package}/{short}\n{_share_file(name, '.msg').read_text()}")
    return f"\n{_SEPARATOR}\n".join(part.rstrip("\n") for part in parts) + "\n"


@cache
def _encoder(type_name: str) -> Any:
    # Imported at the first use: a tracker that records nothing starts sooner without it.
    from mcap_ros2._dynamic import serialize_dynamic

    return serialize_dynamic(type_name, definition(type_name))[type_name]


def encode(message: Any) -> bytes:
    """Return a message as CDR, the same bytes every time.

    The middleware's own serialisation leaves padding uninitialised, so equal messages may differ
    in their bytes. Files that must be reproducible are written with this function.
    """
    encoded: bytes = _encoder(type_name(type(message)))(_numbers(message))
    return encoded


def _numbers(message: Any) -> Any:
    """Return a message as the encoder expects it: fields of type ``byte`` as numbers."""
    types = message.get_fields_and_field_types()
    if not any(kind == "octet" or "/" in kind for kind in types.values()):
        return message
    return {name: _number(getattr(message, name)) for name in types}


def _number(value: Any) -> Any:
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if isinstance(value, list):
        return [_number(entry) for entry in value]
    return _numbers(value) if hasattr(value, "get_fields_and_field_types") else value


def decode(data: bytes, type_name: str) -> Any:
    """Return the message of the given type that CDR bytes contain.

    Raises
    ------
    RejectedMessageError
        ``schema`` if the bytes are not such a message.
    """
    try:
        return deserialize_message(data, message_class(type_name))
    except Exception as error:  # the middleware raises several kinds on foreign bytes
        raise RejectedMessageError("schema", f"no {type_name}: {error}") from error
