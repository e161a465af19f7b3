# SPDX-License-Identifier: Apache-2.0
"""How many messages of each sender are accepted, on a clock turned by hand."""

from __future__ import annotations

from bt_agents_ros.workarounds.sender_identity import SenderRates


class Rates:
    """Ten messages a second of each sender."""

    def __init__(self) -> None:
        self.now = 0.0
        self._rates = SenderRates(10.0, lambda: self.now)

    def accepted(self, sender: str, at: float) -> bool:
        self.now = at
        return self._rates(sender)


def test_sender_within_rate_is_accepted() -> None:
    rates = Rates()

    assert all(rates.accepted("a", at=0.125 * number) for number in range(50))


def test_flood_is_limited_to_allowed_rate() -> None:
    rates = Rates()

    assert sum(rates.accepted("a", at=number / 1024) for number in range(1024)) in (9, 10)


def test_flood_from_one_sender_does_not_limit_another() -> None:
    rates = Rates()
    for number in range(100):
        at = number / 8
        rates.accepted("flood", at)
        assert not rates.accepted("flood", at)
        assert rates.accepted("a", at)


def test_number_of_remembered_senders_is_limited() -> None:
    rates = Rates()
    for number in range(5_000):
        rates.accepted(f"sender {number}", at=0.0)

    assert len(rates._rates._next_s) <= 1_000
