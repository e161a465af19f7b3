# SPDX-License-Identifier: Apache-2.0
"""What a skipped test counts as."""

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
def test_in_ci_a_test_is_skipped_only_for_want_of_network_namespaces(reason, environment, outcome):
    skipped = report(reason)
    judge(skipped, environment)
    assert skipped.outcome == outcome


def test_the_failure_names_the_place_and_the_reason():
    skipped = report("there is no npm here")
    judge(skipped, {"CI": "true"})
    assert skipped.longrepr == "tests/test_some.py:3: skipped in CI: there is no npm here"
