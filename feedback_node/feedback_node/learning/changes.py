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
    """Recorded change; vectors in the order of the space, NaN for missing values.

    Attributes:
        revision: Row of the ledger, with agent, layer, cause and time.
        target: Vector that the profile moved towards or away from; NaN for no opinion.
        rates: Fraction of the distance that each parameter moved; empty if all moved by the
            learning rate.
        false_rate: Estimated share of wrong feedback for the profile, 0..1; NaN for too little
            feedback.
        fresh: False if the same feedback was recorded earlier and not applied again.
        others: Changes of the same feedback in other layers.
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
        """This change and ``others``."""
        return (self, *self.others)


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """Profile to send to a host, which bids with it from then on.

    Attributes:
        host: Full name of the host.
        agent: Agent of the profile; empty if the host must forget all of its layers.
        layer: Layer of the profile; empty for the profile for everybody.
        remove: True if the host must forget it.
        values: The profile; empty if it is removed.
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
    """Return the changes of one feedback as a single change with all texts."""
    first, *others = changes
    more = [one.text if one.revision.layer else f"for everybody {one.text}" for one in others]
    text = "; ".join([first.text, *more])
    return replace(first, text=text, others=tuple(others))
