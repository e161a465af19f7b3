# SPDX-License-Identifier: Apache-2.0
"""Control of a host's runs by people: pause, single steps and breakpoints."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.run_key import RunKey
from bt_agents_core.text import join_quoted
from bt_agents_language.diagnostics.collection import did_you_mean

MOST_BREAKPOINTS = 500
"""Most breakpoints of all agents of a host."""

_LONGEST_SHOWN = 80


class RunControl:
    """Pause of the current run, and breakpoints of all agents, which outlive runs.

    Args:
        changed: Called after each change, to publish it.

    Attributes:
        run: The current run; None without one.
        paused: Whether its tree is ticked only by steps until it is resumed.
        paused_at: Path of the node whose breakpoint paused it; else empty.
        author: Who paused it or last changed the breakpoints.
        breakpoints: Agent → paths of the nodes before which its runs pause.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self.run: RunKey | None = None
        self.paused = False
        self.paused_at = ""
        self.author = ""
        self.breakpoints: dict[str, tuple[str, ...]] = {}
        self._changed = changed
        self._ticking = False

    def begin(self, run: RunKey) -> None:
        """Start the control of a run whose tree will be ticked."""
        self.run, self._ticking = run, True
        self._changed()

    def end(self) -> None:
        """End the control of the run and its pause."""
        self.run, self._ticking = None, False
        self.paused, self.paused_at = False, ""
        self._changed()

    def end_ticking(self) -> None:
        """Handle the end or stop of the tree; its clean-up is not paused."""
        self._ticking = False
        if self.paused:
            self.paused, self.paused_at = False, ""
            self._changed()

    def check(self, epoch: str, round_number: int) -> RunKey:
        """Return the current run if a request is about it; empty and 0 mean any run.

        Raises:
            Refused: ``NOT_RUNNING``, ``OTHER_ROUND`` or ``ENDING``.
        """
        run = self.run
        if run is None:
            raise Refused(RefusalCode.NOT_RUNNING, "no tree of this host is running")
        if (epoch and epoch != run.epoch) or (round_number and round_number != run.round):
            raise Refused(
                RefusalCode.OTHER_ROUND,
                f"{run.agent} runs in round {run.round} of the market {run.epoch[:40]}, not in "
                f"round {round_number} of {epoch[:40] or 'it'}; without a round it is the run "
                "under way that is meant",
            )
        if not self._ticking:
            raise Refused(
                RefusalCode.ENDING,
                f"the tree of {run.agent} has ended; its clean-up is not paused",
            )
        return run

    def pause(self, author: str) -> None:
        """Pause the current run.

        Raises:
            Refused: ``ALREADY_PAUSED``.
        """
        if self.paused:
            paused = pause_text(self.paused_at, self.author)
            raise Refused(RefusalCode.ALREADY_PAUSED, f"it is {paused} already")
        self.paused, self.paused_at, self.author = True, "", author
        self._changed()

    def resume(self, author: str) -> None:
        """End the pause.

        Raises:
            Refused: ``NOT_PAUSED``.
        """
        self.check_paused()
        self.paused, self.paused_at, self.author = False, "", author
        self._changed()

    def check_paused(self) -> None:
        """Check that the run is paused.

        Raises:
            Refused: ``NOT_PAUSED``.
        """
        if not self.paused:
            raise Refused(RefusalCode.NOT_PAUSED, "the run is not paused; pause it first")

    def on_tick(self, held: Sequence[str]) -> bool:
        """Handle the nodes that a tick held; return whether that pauses the run."""
        at = held[0] if held else ""
        pauses = bool(at) and not self.paused
        if at != self.paused_at:
            self.paused, self.paused_at = self.paused or pauses, at
            self._changed()
        return pauses

    def set_breakpoints(
        self, agent: str, paths: Sequence[str], nodes: Collection[str], author: str
    ) -> None:
        """Set all breakpoints of an agent; ``nodes`` are the paths in its tree.

        Raises:
            Refused: ``UNKNOWN_NODE`` or ``TOO_MANY``.
        """
        unknown = [path[:_LONGEST_SHOWN] for path in paths if path not in nodes]
        if unknown:
            hint = did_you_mean(unknown[0], nodes) or f"'bt-agents breakpoint {agent}' lists them"
            raise Refused(
                RefusalCode.UNKNOWN_NODE,
                f"the tree of {agent} has no node {join_quoted(unknown)}; {hint}",
            )
        others = {name: kept for name, kept in self.breakpoints.items() if name != agent}
        count = sum(map(len, others.values())) + len(set(paths))
        if count > MOST_BREAKPOINTS:
            raise Refused(
                RefusalCode.TOO_MANY,
                f"this host would have {count} breakpoints, at most {MOST_BREAKPOINTS} may be",
            )
        if paths:
            others[agent] = tuple(dict.fromkeys(paths))
        self.breakpoints, self.author = dict(sorted(others.items())), author
        self._changed()


def pause_text(paused_at: str, author: str) -> str:
    """Return a description of a pause: ``paused by anna``, ``paused before tree/1.ask``."""
    if paused_at:
        return f"paused before {paused_at}"
    return f"paused by {author}" if author else "paused"
