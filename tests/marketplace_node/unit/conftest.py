# SPDX-License-Identifier: Apache-2.0
"""Markets with the hosts that most tests need."""

from __future__ import annotations

import pytest

from market_harness import GUIDE, PLAIN, MarketHarness


@pytest.fixture
def market() -> MarketHarness:
    """A market with one host, of the guide and the express."""
    harness = MarketHarness()
    harness.register()
    return harness


@pytest.fixture
def two() -> MarketHarness:
    """A market that has awarded a scene to the first of two hosts."""
    market = MarketHarness()
    market.register()
    market.register("/others", PLAIN)
    market.scene()
    market.bid()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})
    assert market.goal.agent == GUIDE
    return market
