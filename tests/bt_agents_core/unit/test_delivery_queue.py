# SPDX-License-Identifier: Apache-2.0
"""Delivery queue: which message is sent when, on a manual clock."""

from __future__ import annotations

from random import Random

import pytest

from bt_agents_core.delivery_queue import DeliveryQueue


class Post:
    """A delivery queue on a manual clock."""

    def __init__(self, most: int = 3) -> None:
        self.now = 50.0
        self.letters: DeliveryQueue[str] = DeliveryQueue(lambda: self.now, most=most, answer_s=2.0)

    def send(self) -> str | None:
        """Send the due items; return them."""
        letter = self.letters.next_to_send
        if letter is not None:
            self.letters.sent()
        return letter


def test_queue_sends_next_message_only_after_acknowledgement():
    post = Post()
    for letter in ("a", "b"):
        assert post.letters.enqueue(letter) is None
    assert (post.send(), post.send()) == ("a", None)
    assert post.letters.acknowledge("a")
    assert (post.send(), len(post.letters)) == ("b", 1)
    assert post.letters.acknowledge("b")
    assert (post.send(), len(post.letters)) == (None, 0)


def test_unacknowledged_message_is_resent_after_timeout():
    post = Post()
    post.letters.enqueue("a")
    post.send()
    post.now += 1.9
    assert (post.send(), post.letters.overdue) == (None, False)
    post.now += 0.1
    assert post.letters.overdue
    assert post.send() == "a"
    assert not post.letters.overdue


def test_lost_peer_makes_message_due_immediately():
    post = Post()
    post.letters.enqueue("a")
    post.send()
    post.letters.peer_lost()
    assert post.send() == "a"


def test_late_acknowledgement_counts_once():
    post = Post()
    for letter in ("a", "b"):
        post.letters.enqueue(letter)
    post.send()
    post.now += 2.0
    post.send()
    assert post.letters.acknowledge("a")
    assert not post.letters.acknowledge("a")
    assert post.send() == "b"


@pytest.mark.parametrize("under_way", [False, True])
def test_full_queue_drops_oldest_message_even_in_flight(under_way):
    post = Post(most=2)
    post.letters.enqueue("a")
    if under_way:
        post.send()
    assert post.letters.enqueue("b") is None
    assert post.letters.enqueue("c") == "a"
    assert not post.letters.acknowledge("a")
    assert (len(post.letters), post.send()) == (2, "b")


@pytest.mark.parametrize("seed", range(20))
def test_messages_arrive_in_order_despite_losses(seed):
    random = Random(seed)
    post = Post(most=100)
    arrived: list[str] = []
    wanted = [str(number) for number in range(50)]
    waiting = list(wanted)
    for _ in range(10_000):
        if waiting and random.random() < 0.3:
            post.letters.enqueue(waiting.pop(0))
        letter = post.send()
        if letter is not None and random.random() < 0.6:
            if letter not in arrived:
                arrived.append(letter)
            if random.random() < 0.6:
                assert post.letters.acknowledge(letter)
        if random.random() < 0.1:
            post.letters.peer_lost()
        post.now += random.random()
    assert arrived == wanted
    assert len(post.letters) == 0
