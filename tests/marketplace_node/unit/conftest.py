# SPDX-License-Identifier: Apache-2.0
"""Markets with the hosts that most tests need."""

from __future__ import annotations

import pytest

from market_harness import GUIDE, PLAIN, MarketHarness, with_host


@pytest.fixture
def market() -> MarketHarness:
    """A market with one host, of the guide and the express."""
    return with_host()


@pytest.fixture
def running(market: MarketHarness) -> MarketHarness:
    """The same market, in which the guide runs for scene s1."""
    market.run()
    return market


@pytest.fixture
def impatient() -> MarketHarness:
    """The same market, which does not wait for hosts."""
    return with_host(host_wait_s=0)


@pytest.fixture
def two() -> MarketHarness:
    """A market that has awarded a scene to the first of two hosts."""
    market = with_host()
    market.register("/others", PLAIN)
    market.award()
    market.bid("/others", {PLAIN: (1.0, 5.0, 5.0)})
    assert market.goal.agent == GUIDE
    return market
