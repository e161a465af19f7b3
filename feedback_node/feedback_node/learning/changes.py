# SPDX-License-Identifier: Apache-2.0
"""Recorded changes of profiles, and their deliveries to hosts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from bt_agents_core.scene import SceneSpace, Vector
from feedback_node.ledger.rows import ProfileRevision


@dataclass(frozen=True, kw_only=True)
class ProfileChange:
    """Recorded change; vectors in the order of the space, NaN for what was not there.

    Attributes:
        revision: Row of the ledger, with agent, layer, cause and time.
        target: Vector moved towards or away from; NaN for no opinion.
        rates: What each parameter has moved by, of the distance; empty when all by the learning
            rate.
        false_rate: 0..1, how much of what the profile was taught seems to be wrong; NaN when too
            little is known.
        fresh: False when the same feedback had been recorded earlier and was not applied again.
        others: What the same feedback has changed in other layers.
    """

    revision: ProfileRevision
    before: Vector
    after: Vector
    target: Vector
    rates: Vector = ()
    false_rate: float = math.nan
    fresh: bool
    text: str
    others: tuple[ProfileChange, ...] = ()

    @property
    def all(self) -> tuple[ProfileChange, ...]:
        """This one and the others."""
        return (self, *self.others)


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """Profile to be sent to a host, which bids with it from then on.

    Attributes:
        host: Its full name.
        agent: Whose profile; empty when the host is to forget all layers that it has.
        layer: Empty for everybody's.
        remove: True when the host is to forget it.
        values: The profile; empty when it is removed.
    """

    host: str
    agent: str
    layer: str = ""
    remove: bool = False
    values: Vector = ()
    revision: int = 0


Table = tuple[tuple[str, str, int, Vector], ...]
"""Name, layer, revision and profile of every known agent and layer, by name and layer."""


def changed(
    revision: ProfileRevision,
    before: ProfileRevision,
    space: SceneSpace,
    *,
    fresh: bool,
    text: str,
    false_rate: float = math.nan,
) -> ProfileChange:
    """Return a recorded change as vectors; see :class:`ProfileChange`."""
    rates = revision.cause.rates
    return ProfileChange(
        revision=revision,
        before=space.ordered(before.profile),
        after=space.ordered(revision.profile),
        target=space.ordered(revision.cause.target),
        rates=space.ordered(rates) if rates else (),
        false_rate=false_rate,
        fresh=fresh,
        text=text,
    )


def moved(before: ProfileRevision, after: ProfileRevision) -> str:
    """Return the difference of two revisions as text."""
    moves = [
        f"{name} {before.profile.get(name, math.nan):.4g} → {value:.4g}"
        for name, value in after.profile.items()
        if before.profile.get(name) != value
    ]
    return ", ".join(moves) or "the profile stays as it is"


def together(changes: Sequence[ProfileChange]) -> ProfileChange:
    """Return the changes of one feedback as one, with the texts of all."""
    first, *others = changes
    more = [one.text if one.revision.layer else f"for everybody {one.text}" for one in others]
    text = "; ".join([first.text, *more])
    return replace(first, text=text, others=tuple(others))
