# SPDX-License-Identifier: Apache-2.0
"""A recorded system."""

from __future__ import annotations

import pytest

from journal_fixture import JournaledSystem, morning


@pytest.fixture(scope="module")
def journaled(tmp_path_factory: pytest.TempPathFactory) -> JournaledSystem:
    """Return a system after four rounds, with runs and feedback."""
    return morning(tmp_path_factory.mktemp("journaled") / "trees")
