# SPDX-License-Identifier: Apache-2.0
"""Synchronisation of one robot's ledger with the database of its fleet.

The ledger is the truth. The database stores the pushed position in the transaction of the steps;
the ledger stores the pulled position in the transaction of the steps. So a cycle may be
interrupted anywhere: the next one continues where both agree.
"""

from __future__ import annotations

import json
import sqlite3
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.feedback import Share
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_fleet.database import BATCH, FleetDatabase, PushPosition, Wanted
from bt_agents_fleet.shares import includes
from feedback_node.learning.fleet_steps import (
    FleetStep,
    StepEvent,
    own_steps,
    read_step,
    recorded_step,
)
from feedback_node.ledger.file import connect, unread
from feedback_node.ledger.reading import LedgerReader
from feedback_node.ledger.rows import FORGOTTEN
from feedback_node.management.fleet_documents import MOST_STEPS, refusals_of, to_fleet_document

MOST_REFUSED = 100
"""Maximum number of the newest refused steps to keep; the database has all."""

MOST_BATCHES = 50
"""Maximum number of batches per direction in one cycle."""

_ROWS = 500
"""Number of ledger rows to read at once."""

Deliver = Callable[[str], str]
"""Sends a document to the feedback node and returns its answer; may raise BtAgentsError."""


@dataclass(frozen=True, kw_only=True)
class RefusedStep:
    """Refused step of another robot."""

    robot: str
    number: int
    code: str
    reason: str


@dataclass(kw_only=True)
class FleetStatus:
    """Progress of a robot's synchronisation.

    Attributes:
        problem: Why the last cycle failed; empty if it succeeded.
        at: Time of the last cycle [s since 1970].
        pushed: Number of the last ledger row that the database covers; -1 if unknown.
        last: Number of the last ledger row.
        taken: Number of other robots' steps in the ledger.
        refused: Number of steps refused since the start of the process.
        aside: The newest refused steps.
    """

    problem: str = ""
    at: float = 0.0
    pushed: int = -1
    last: int = 0
    taken: int = 0
    refused: int = 0
    aside: deque[RefusedStep] = field(default_factory=lambda: deque(maxlen=MOST_REFUSED))

    def to_json(self) -> str:
        """Return the status as JSON for the status file."""
        return json.dumps({**vars(self), "aside": [asdict(one) for one in self.aside]})


@dataclass(kw_only=True)
class _LedgerIndex:
    """Index of the ledger rows read so far.

    Attributes:
        bases: Agent → version of the profile in its file.
        arrivals: Agent and base → arrival of the last step of others in the ledger.
        taken: Robot and number of all steps of others in the ledger.
        counts: Agent and base → number of steps of others in the ledger.
        unordered: Agents with own steps since the feedback node last ordered the steps.
    """

    last: int = 0
    bases: dict[str, str] = field(default_factory=dict)
    arrivals: dict[tuple[str, str], int] = field(default_factory=dict)
    taken: set[tuple[str, int]] = field(default_factory=set)
    counts: dict[tuple[str, str], int] = field(default_factory=dict)
    unordered: set[str] = field(default_factory=set)


class FleetSync:
    """Synchronisation of one ledger with one database in cycles.

    Args:
        robot: Name of this robot.
        space: Its space of profiles.
        ledger: Ledger file, which the feedback node may be writing.
        database: The database of the fleet.
        deliver: Sends a document to the feedback node.
        shares: Returns the shared layers of each agent.
        wall: Returns the wall time [s].
    """

    def __init__(
        self,
        robot: str,
        space: SceneSpace,
        ledger: Path,
        database: FleetDatabase,
        deliver: Deliver,
        shares: Callable[[], Mapping[str, Share]],
        *,
        wall: Callable[[], float],
    ) -> None:
        self.status = FleetStatus()
        self._robot = robot
        self._space = space
        self._path = ledger
        self._database = database
        self._deliver = deliver
        self._shares = shares
        self._wall = wall
        self._index = _LedgerIndex()
        self._refused: dict[tuple[str, int], tuple[str, str]] = {}
        self._shared: Mapping[str, Share] = {}
        self._agrees = False

    def cycle(self) -> None:
        """Push and pull new steps.

        Raises:
            BtAgentsError: The cycle failed; the next one continues. It is a :class:`FleetError`
                if the database is the reason.
        """
        self.status.at = self._wall()
        try:
            self._cycle()
        except BtAgentsError as error:
            self._agrees = self._agrees and self._database.is_connected
            self.status.problem = str(error)
            raise
        self.status.problem = ""

    def _cycle(self) -> None:
        if not self._path.is_file():
            raise Refused(
                RefusalCode.NO_LEDGER, f"{self._path} is not there yet; 'bt-agents up' makes it"
            )
        shares = dict(self._shares())
        if shares != self._shared:
            # Steps that are wanted now may have been skipped before.
            self._shared, self._agrees = shares, False
        with self._open() as ledger:
            self._read(ledger)
            if not self._agrees:
                self._database.connect()
                self._check(ledger, self._database.position())
            self._push(ledger, shares)
        wanted = self._wanted(shares)
        if not self._agrees:
            self._compare(wanted)
            self._agrees = True
        self._pull(shares)

    @contextmanager
    def _open(self) -> Iterator[LedgerReader]:
        path = str(self._path)
        try:
            opened = connect(path, "ro")
        except sqlite3.Error as error:
            raise unread(path, error) from error
        with closing(opened):
            yield LedgerReader(opened, path)

    def _read(self, ledger: LedgerReader) -> None:
        """Bring the index up to date with the ledger."""
        index = self._index
        if index.last and ledger.checksum(index.last) is None:
            # Another file has taken its place.
            index = self._index = _LedgerIndex()
            self._agrees = False
        known = index.last
        while entries := ledger.entries(after=index.last, most=_ROWS):
            if known and any(one.cause.cause == FORGOTTEN for _, one in entries):
                # Rows that were read before have been erased.
                index = self._index = _LedgerIndex()
                self._agrees = False
                known = 0
                continue
            index.unordered |= {
                step.agent for step in own_steps(entries, self._robot, index.bases)
            }
            for number, revision in entries:
                index.last = number
                if (step := recorded_step(revision)) and step.robot != self._robot:
                    self._note(step)
        self.status.last, self.status.taken = index.last, len(index.taken)

    def _note(self, step: FleetStep) -> None:
        index, name = self._index, (step.robot, step.number)
        if name in index.taken:
            return
        index.taken.add(name)
        # A removal counts, whatever the agent's file says.
        pair = step.agent, "" if step.event is StepEvent.FORGET else step.base
        index.counts[pair] = index.counts.get(pair, 0) + 1
        index.arrivals[pair] = max(index.arrivals.get(pair, 0), step.arrival)

    def _check(self, ledger: LedgerReader, position: PushPosition) -> None:
        """Check that the database covers this ledger and not another one.

        Raises:
            Refused: ``OTHER_LEDGER``.
        """
        if not position.ledger:
            return
        found = ledger.checksum(position.number) if position.number else 0
        is_other = found and position.checksum and found != position.checksum
        if ledger.checksum(1) != position.ledger or found is None or is_other:
            raise Refused(
                RefusalCode.OTHER_LEDGER,
                f"{self._path} is not the ledger that '{self._robot}' has pushed up to row "
                f"{position.number}: put that one back; or move this one away too, and join under "
                "another name with an empty one, to which the database gives back what was shared",
            )

    # To the database

    def _push(self, ledger: LedgerReader, shares: Mapping[str, Share]) -> None:
        declared = json.dumps({agent: share.value for agent, share in sorted(shares.items())})
        before = self._database.position()
        # Layers shared now may not have been shared before; existing steps are not added again.
        start = before.number if before.shares == declared else 0
        bases = _bases_at(ledger, start)
        for _ in range(MOST_BATCHES):
            entries = ledger.entries(after=start, most=BATCH)
            if not entries and before.shares == declared:
                break
            steps = [
                step for step in own_steps(entries, self._robot, bases) if is_shared(step, shares)
            ]
            start = entries[-1][0] if entries else start
            after = PushPosition(
                number=start,
                checksum=ledger.checksum(start) or 0,
                ledger=ledger.checksum(1) or 0,
                shares=declared,
            )
            self._database.push(before, steps, after)
            self.status.pushed = after.number
            before = after
        self.status.pushed = before.number

    # From the database

    def _wanted(self, shares: Mapping[str, Share]) -> list[Wanted]:
        bases, arrivals = self._index.bases, self._index.arrivals
        return [
            Wanted(
                agent=agent,
                share=share,
                base=bases[agent],
                after=arrivals.get((agent, bases[agent]), 0),
            )
            for agent, share in sorted(shares.items())
            if agent in bases
        ]

    def _compare(self, wanted: Sequence[Wanted]) -> None:
        """Start again with agents that have more steps in the database than in the ledger.

        The arrivals in a database restored from a backup differ.
        """
        there = self._database.count([replace(one, after=0) for one in wanted]) if wanted else {}
        for one in wanted:
            pair = one.agent, one.base
            known = self._index.counts.get(pair, 0) + self._index.counts.get((one.agent, ""), 0)
            known += list(self._refused.values()).count(pair)
            if there.get(one.agent, 0) != known:
                self._index.arrivals[pair] = 0

    def _pull(self, shares: Mapping[str, Share]) -> None:
        waiting: set[str] = set()
        for _ in range(MOST_BATCHES):
            wanted = [one for one in self._wanted(shares) if one.agent not in waiting]
            rows = self._database.pull(wanted) if wanted else []
            waiting.update(self._take(rows, shares))
            if len(rows) < BATCH:
                break
        taught = {agent for agent, _ in self._index.counts}
        if unordered := sorted(self._index.unordered & shares.keys() & taught):
            self._hand_over(unordered, [])
        self._index.unordered.clear()

    def _take(self, rows: Sequence[Mapping[str, Any]], shares: Mapping[str, Share]) -> set[str]:
        """Deliver rows; return the agents whose steps the feedback node does not accept yet."""
        steps: list[FleetStep] = []
        for row in rows:
            name = str(row["robot"]), int(row["number"])
            pair = str(row["agent"]), self._index.bases[str(row["agent"])]
            if name in self._index.taken or name in self._refused:
                continue
            try:
                fields = {**row, "target": _target(row["target"])}
                step = read_step(fields, self._space, now=self._wall())
                if not is_shared(step, shares):
                    raise Refused(
                        RefusalCode.NOT_SHARED, f"step {name[0]}/{name[1]}: {step.layer[:80]!a}"
                    )
                steps.append(step)
            except Refused as refusal:
                self._put_aside(name, pair, refusal.code, refusal.reason)
        waiting: set[str] = set()
        for start in range(0, len(steps), MOST_STEPS):
            waiting |= self._hand_over([], steps[start : start + MOST_STEPS])
        for row in rows:
            agent = str(row["agent"])
            pair = agent, self._index.bases[agent]
            if agent not in waiting:
                before = self._index.arrivals.get(pair, 0)
                self._index.arrivals[pair] = max(before, int(row["arrival"]))
        return waiting

    def _hand_over(self, agents: Sequence[str], steps: Sequence[FleetStep]) -> set[str]:
        """Deliver steps; return the agents for which some are too early."""
        answer = self._deliver(to_fleet_document(self._robot, agents, steps))
        refused = {(one["robot"], one["number"]): one for one in refusals_of(answer)}
        waiting = set()
        for step in steps:
            name = step.robot, step.number
            if name not in refused:
                self._note(step)
            elif refused[name]["later"]:
                waiting.add(step.agent)
            else:
                code, reason = refused[name]["code"], refused[name]["reason"]
                self._put_aside(name, (step.agent, step.base), code, reason)
        self.status.taken = len(self._index.taken)
        return waiting

    def _put_aside(
        self, name: tuple[str, int], pair: tuple[str, str], code: str, reason: str
    ) -> None:
        self._refused[name] = pair
        self.status.refused = len(self._refused)
        robot, number = name
        self.status.aside.append(RefusedStep(robot=robot, number=number, code=code, reason=reason))


def is_shared(step: FleetStep, shares: Mapping[str, Share]) -> bool:
    """Return whether a step may leave its robot and may be accepted."""
    return step.agent in shares and includes(shares[step.agent], step.layer)


def _bases_at(ledger: LedgerReader, number: int) -> dict[str, str]:
    """Return the base of each agent at a ledger row."""
    bases: dict[str, str] = {}
    last = 0
    while last < number and (entries := ledger.entries(after=last, most=_ROWS)):
        last = entries[-1][0]
        for _ in own_steps([one for one in entries if one[0] <= number], "-", bases):
            pass
    return bases


def _target(text: Any) -> Any:
    """Return the values of a row; invalid JSON gives an empty mapping, which no step has."""
    try:
        return json.loads(str(text))
    except (ValueError, RecursionError):
        return {}
