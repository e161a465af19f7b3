# SPDX-License-Identifier: Apache-2.0
"""Skipped tests fail in CI."""

from __future__ import annotations

import pytest

from skipped_tests import NAMESPACES, judge


def report(reason: str, outcome: str = "skipped") -> pytest.TestReport:
    longrepr = ("tests/test_some.py", 3, f"Skipped: {reason}")
    place = ("tests/test_some.py", 3, "test_some")
    return pytest.TestReport("some", place, {}, outcome, longrepr, "setup")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("reason", "environment", "outcome"),
    [
        ("there is no npm here", {"CI": "true"}, "failed"),
        ("there is no npm here", {}, "skipped"),
        (f"{NAMESPACES}: Operation not permitted", {"CI": "true"}, "skipped"),
    ],
)
def test_ci_allows_skips_only_for_missing_network_namespaces(reason, environment, outcome):
    skipped = report(reason)
    judge(skipped, environment)
    assert skipped.outcome == outcome


def test_failure_names_skip_location_and_reason():
    skipped = report("there is no npm here")
    judge(skipped, {"CI": "true"})
    assert skipped.longrepr == "tests/test_some.py:3: skipped in CI: there is no npm here"
