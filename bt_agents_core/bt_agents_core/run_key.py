# SPDX-License-Identifier: Apache-2.0
"""Identity of a run among all runs of all markets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class RunKey:
    """Identity of a run: market, round and agent; round 0 means no run.

    A round has several runs if agents refuse theirs.
    """

    epoch: str
    round: int = 0
    agent: str = ""

    @classmethod
    def of(cls, named: Any) -> RunKey:
        """Return the run that a goal, an event, a heartbeat or a status names."""
        return cls(epoch=named.epoch, round=named.round, agent=named.agent)
