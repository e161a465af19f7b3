# SPDX-License-Identifier: Apache-2.0
"""A test that is skipped in CI has failed, unless a machine of CI may lack what it needs."""

from __future__ import annotations

import os
from collections.abc import Mapping

import pytest

NAMESPACES = "no network namespaces"
"""Beginning of the reason where the system refuses them, as in most containers."""

_MAY_BE_SKIPPED = (NAMESPACES,)


def judge(
    report: pytest.TestReport | pytest.CollectReport, environment: Mapping[str, str] = os.environ
) -> None:
    """Make a report of a skipped test one of a failed test, in CI."""
    if not (environment.get("CI") and report.skipped and isinstance(report.longrepr, tuple)):
        return
    path, line, reason = report.longrepr
    reason = reason.removeprefix("Skipped: ")
    if not reason.startswith(_MAY_BE_SKIPPED):
        report.outcome = "failed"
        report.longrepr = f"{path}:{line}: skipped in CI: {reason}"
