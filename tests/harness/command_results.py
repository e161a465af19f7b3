# SPDX-License-Identifier: Apache-2.0
"""Commands in this process, with standard output apart from standard error."""

from __future__ import annotations

import inspect
from typing import Any

from click.testing import CliRunner


def split_runner() -> CliRunner:
    """Runner whose results keep standard output apart from standard error.

    Click 8.1 of Ubuntu 24.04 mixes them unless told otherwise; later versions never do.
    """
    options: dict[str, Any] = {}
    if "mix_stderr" in inspect.signature(CliRunner).parameters:
        options["mix_stderr"] = False
    return CliRunner(**options)
