# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Why a message or a bag was refused."""

from __future__ import annotations


class RejectedMessageError(ValueError):
    """A message that does not fit the contract; the whole of it is refused.

    Parameters
    ----------
    reason : str
        Short and countable: ``schema``, ``frame`` or ``oversize``.
    detail : str
        What was wrong, where, and what is allowed.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason


class BagError(Exception):
    """A bag that cannot be used; one line that says which and why.

    Attributes
    ----------
    corrupt : bool
        The file is damaged, rather than missing or of another kind.
    """

    def __init__(self, message: str, corrupt: bool = False) -> None:
        super().__init__(message)
        self.corrupt = corrupt
