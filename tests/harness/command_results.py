# SPDX-License-Identifier: Apache-2.0
"""Commands in this process, with standard output apart from standard error."""

from __future__ import annotations

import inspect
from typing import Any

from click.testing import CliRunner


def split_runner() -> CliRunner:
    """Makes a runner whose results keep standard output apart from standard error.

    Click 8.1, which Ubuntu 24.04 has, mixes them unless told otherwise; later versions cannot.
    """
    options: dict[str, Any] = {}
    if "mix_stderr" in inspect.signature(CliRunner).parameters:
        options["mix_stderr"] = False
    return CliRunner(**options)
