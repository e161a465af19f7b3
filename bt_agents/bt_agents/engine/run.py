# SPDX-License-Identifier: Apache-2.0
"""One run of an agent's tree, from the first tick until every goal it sent has ended."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from importlib import import_module
from pkgutil import iter_modules
from random import Random
from typing import Any, NamedTuple

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from bt_agents.engine import nodes
from bt_agents.engine.breakpoints import Breakpoints
from bt_agents.engine.context import NodeMaker, RunContext
from bt_agents.engine.environment import Clock, Environment
from bt_agents.engine.node_errors import is_undecided
from bt_agents.engine.nodes.plugin import PluginLeaf
from bt_agents.engine.nodes.skill import SkillLeaf
from bt_agents.engine.scope import RunScope, Scope
from bt_agents.engine.ticker import OnVisit, Tick, Ticker
from bt_agents.engine.value_trace import as_written
from bt_agents_core.field_types import Plain
from bt_agents_core.gc_pause import gc_paused
from bt_agents_core.scene import Scene, SceneSpace, Vector
from bt_agents_core.stop_cause import Cancellation
from bt_agents_core.text import excerpt, filled_name
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_language.nodes.catalogue import type_of

_MOST_UNDECIDED = 20
"""Most undecidable conditions that a run reports."""

_MOST_VALUES = 500
"""Most values in the changes of one tick; further ones are left out."""

_LONGEST_NAME = 200
"""Most characters of the name of a tip."""


def find_behaviours() -> dict[str, NodeMaker]:
    """Return the makers of all node modules, by key."""
    found: dict[str, NodeMaker] = {}
    for module in iter_modules(nodes.__path__):
        found |= import_module(f"{nodes.__name__}.{module.name}").BEHAVIOURS
    return found


BEHAVIOURS: Mapping[str, NodeMaker] = find_behaviours()
"""Key of a node type → maker of its behaviour, from the ``BEHAVIOURS`` of all node modules."""


@gc_paused()
def build(spec: NodeSpec, context: RunContext) -> Behaviour:
    """Return the tree of a spec, ready to be ticked; its nodes carry their spec as ``spec``."""

    def build_node(spec: NodeSpec, scope: Scope) -> Behaviour:
        scope.declare(spec.outputs)
        if type_of(spec).assigns:
            scope.declare(spec.fields)
        if spec.plugin is not None:
            return PluginLeaf(spec, context, scope)
        maker = SkillLeaf if spec.skill is not None else BEHAVIOURS[spec.kind]
        return maker(spec, context, scope, build_node)

    return build_node(spec, context.scope)


class TreeOutcome(Enum):
    """How a run ended."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class StatusChange(NamedTuple):
    """An element of the trace of a run: a changed status or message, or another end of a node.

    Nodes with side effects, and those that have changed values, have an element for each end.
    Values are those that the node has changed since its last element, by name, as text.
    """

    path: str
    name: str
    status: Status
    message: str
    values: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """How a run ended.

    Attributes:
        message: Reason in words, with the first condition that could not be decided.
        tip: Path of the node that decided; empty if the tree was never ticked.
        orphans: Paths of the nodes whose goals were not confirmed to have ended.
        ticks: Number of ticks of the tree and its clean-up.
        overruns: Number of ticks that took longer than the period.
        duration_s: Duration on the trees' clock [s].
    """

    outcome: TreeOutcome
    message: str
    tip: str = ""
    orphans: tuple[str, ...] = ()
    ticks: int = 0
    overruns: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Overrun:
    """A tick that took longer than the period.

    Attributes:
        slowest: Path of the leaf that took longest, including the time since the previous leaf;
            that of the outermost node if the time after the last leaf was longer.
    """

    took_s: float
    slowest: str
    slowest_s: float


@dataclass(frozen=True, kw_only=True)
class RunLimits:
    """Bounded waits at the end of a run, on the steady clock [s].

    Attributes:
        explain_s: Wait for the news who stopped it and why, if the agent's ``on_cancel`` uses it.
        settle_s: Wait for the confirmed end of all goals, after the agent's ``on_cancel``.
    """

    explain_s: float = 0.1
    settle_s: float = 2.0


class _Phase(Enum):
    TICKING = 1
    HALTED = 2
    CLEANING = 3
    SETTLING = 4
    ENDED = 5


class Run:
    """Ticks a tree to its end; a cancel stops every leaf, cleans up and waits for open goals.

    Args:
        scene: The scene as awarded.
        live: Returns the current scene.
        tunables: Current values by name; they may change between ticks.
        steady: Clock that never stops, for bounded waits and to measure ticks [s].
        limits: Limits of these waits.
        random: Random source of the nodes; None uses a new one.
        context: Makes the shared state of the nodes.
        host: Fully qualified name of the node that ticks the tree.

    Attributes:
        scope: The names of the run.
        root: The tree.
        clean_up: The tree of the agent's ``on_cancel``; None until it begins.
        period_s: Time between two ticks [s]; a tick that takes longer is an overrun. If it is
            infinite before the first tick, leaves are not measured.
        ticks: Number of ticks so far, of the tree and its clean-up.
        overruns: Number of ticks that took longer than the period.
        deadline: When the current bounded wait ends, on the steady clock [s]; infinite for none.
        deadlines: See :class:`RunContext`.
        overrun: The last tick, if it was an overrun.
        changes: Changes of the last tick so far, in order.
        undecided: Conditions that could not be decided so far, each with its reason and place.
        result: How it ended; None until then.
    """

    def __init__(
        self,
        spec: AgentSpec,
        *,
        space: SceneSpace,
        scene: Scene,
        profile: Vector,
        live: Callable[[], Scene],
        tunables: Mapping[str, Plain],
        environment: Environment,
        steady: Clock,
        limits: RunLimits | None = None,
        random: Random | None = None,
        context: Callable[[Environment, RunScope, Random], RunContext] = RunContext,
        on_visit: OnVisit | None = None,
        host: str = "",
    ) -> None:
        scope = RunScope(
            space=space,
            scene=scene,
            live=live,
            profile=profile,
            tunables=tunables,
            agent=spec.name,
            host=host,
            clock=environment.local_time,
        )
        self.spec = spec
        self.period_s = math.inf
        self.ticks = 0
        self.overruns = 0
        self.overrun: Overrun | None = None
        self.changes: list[StatusChange] = []
        self._values_left = _MOST_VALUES
        self.result: RunResult | None = None
        self.scope = scope
        self._context = context(environment, scope, random or Random())
        self.deadlines = self._context.deadlines
        self._steady = steady
        self._limits = limits or RunLimits()
        self._on_visit = on_visit
        self.root = build(spec.tree, self._context)
        self.clean_up: Behaviour | None = None
        self._tickers: dict[Behaviour, Ticker] = {}
        self.undecided: dict[str, None] = {}
        self._answered_at = 0.0
        self._slowest = self.root
        self._slowest_s = 0.0
        self._breakpoints: Breakpoints | None = None
        self._phase = _Phase.TICKING
        self._start = environment.clock()
        self.deadline = math.inf
        self._end = (TreeOutcome.CANCELLED, "", "")

    @property
    def tip(self) -> str:
        """Path of the deepest node that decides the status of the tree."""
        return self.held[0] if self.held else _path_of(self._tip)

    @property
    def tip_name(self) -> str:
        """Name of the tip for people, with its current values."""
        tip = self._tip
        if self.held:
            tip = next(node for node in self.root.iterate() if _path_of(node) == self.held[0])
        if tip is None:
            return ""
        message = tip.feedback_message if tip.status is Status.RUNNING else ""
        return excerpt(filled_name(tip.name, message), _LONGEST_NAME)

    @property
    def held(self) -> tuple[str, ...]:
        """Paths of the nodes that wait at a breakpoint since the last tick of the tree."""
        stops = self._breakpoints
        return () if stops is None or not self.ticking else stops.held

    @property
    def ticking(self) -> bool:
        """True until the tree has ended or was stopped; its clean-up follows."""
        return self._phase is _Phase.TICKING

    @property
    def _tip(self) -> Behaviour | None:
        tip: Behaviour | None = (self.clean_up or self.root).tip()
        return tip

    def set_breakpoints(self, paths: Collection[str]) -> None:
        """Set the nodes of the tree that start one tick later than their turn.

        The clean-up has no breakpoints: it must complete.
        """
        if self._breakpoints is None:
            if not paths:
                return
            self._breakpoints = Breakpoints(self._ticker(self.root))
        self._breakpoints.set(paths)

    def report_visits(self, on_visit: OnVisit | None) -> None:
        """Report each ticked node to a listener from the next tick on; None stops that."""
        self._on_visit = on_visit
        for ticker in self._tickers.values():
            ticker.report_visits(on_visit)
        if self._breakpoints is not None:
            self._breakpoints.replace_again()

    def tick(self) -> list[StatusChange]:
        """Tick once, in any phase of the run; return the changes in order."""
        self.changes = []
        self._values_left = _MOST_VALUES
        self.overrun = None
        self.deadlines.clear()
        if self.scope.mood_start.is_given:
            self.scope.mood_start.follow(self.scope.live())
        if self._breakpoints is not None:
            self._breakpoints.begin_tick()
        if self._phase is _Phase.HALTED and self._steady() >= self.deadline:
            self._clean(None)
        match self._phase:
            case _Phase.TICKING:
                self._tick(self.root)
                if self.root.status is not Status.RUNNING:
                    self._finish_tree()
            case _Phase.CLEANING:
                assert self.clean_up is not None
                if self._steady() >= self.deadline:
                    self._stop_cleaning()
                else:
                    self._tick(self.clean_up)
                    if self.clean_up.status is not Status.RUNNING:
                        self._settle()
        if self._phase is _Phase.SETTLING:
            self._try_end()
        return self.changes

    def cancel(
        self, reason: str, *, clean_up: bool = True, cancellation: Cancellation | None = None
    ) -> list[StatusChange]:
        """Stop every running leaf now; a run that is already ending continues to end.

        A run whose tree has ended and that only waits for goals keeps its outcome. A tree that was
        never ticked has nothing to clean up. Without ``clean_up`` the agent's ``on_cancel`` is
        skipped, or stopped if it runs. An ``on_cancel`` that names who stopped the run waits for a
        bounded time until another call brings the ``cancellation``.
        """
        self.changes = []
        if self._phase is _Phase.HALTED:
            if not clean_up:
                self._settle()
                self._try_end()
            elif cancellation is not None:
                self._clean(cancellation)
        elif self._phase is _Phase.CLEANING and not clean_up:
            self._stop_cleaning()
        if self._phase is not _Phase.TICKING:
            return self.changes
        tip = self.tip if self.ticks else ""
        self._ticker(self.root).halt()
        self._end = (TreeOutcome.CANCELLED, reason, tip)
        if self.spec.on_cancel is None or not clean_up or not self.ticks:
            self._settle()
            self._try_end()
        elif cancellation is None and self.spec.names_cancellation:
            self._phase = _Phase.HALTED
            self.deadline = self._steady() + self._limits.explain_s
        else:
            self._clean(cancellation)
        return self.changes

    def shorten_settling(self, settle_s: float) -> None:
        """Shorten the wait for the confirmed end of goals, from now or from its start [s]."""
        self._limits = replace(self._limits, settle_s=min(self._limits.settle_s, settle_s))
        if self._phase is _Phase.SETTLING:
            self.deadline = min(self.deadline, self._steady() + settle_s)

    def give_up(self, reason: str) -> RunResult:
        """Stop every leaf and end at once, without clean-up or waiting; return how it ended."""
        for tree in (self.root, self.clean_up):
            # The cause may prevent stopping, too.
            with suppress(Exception):
                if tree is not None:
                    self._ticker(tree).halt()
        self._end = (TreeOutcome.FAILED, reason, "")
        self.deadline = self._steady()
        self._try_end()
        assert self.result is not None
        return self.result

    def _finish_tree(self) -> None:
        if self.root.status is Status.SUCCESS:
            self._end = (TreeOutcome.SUCCEEDED, "the tree succeeded", self.tip)
        else:
            self._end = (TreeOutcome.FAILED, _reason(self.root), self.tip)
        self._settle()

    def _clean(self, cancellation: Cancellation | None) -> None:
        """Begin the agent's ``on_cancel``, even if it is unknown who stopped the run."""
        assert self.spec.on_cancel is not None
        self.scope.cancellation = cancellation
        self.clean_up = build(self.spec.on_cancel, self._context)
        self._phase = _Phase.CLEANING
        self.deadline = self._steady() + self.spec.clean_up_s

    def _stop_cleaning(self) -> None:
        assert self.clean_up is not None
        self._ticker(self.clean_up).halt()
        self._settle()

    def _settle(self) -> None:
        self._phase = _Phase.SETTLING
        self.deadline = self._steady() + self._limits.settle_s

    def _report_undecided(self, message: str) -> None:
        """Log an undecidable condition once, because handling its failure hides it."""
        if message not in self.undecided and len(self.undecided) < _MOST_UNDECIDED:
            self.undecided[message] = None
            self._context.environment.log("error", message)

    def _try_end(self) -> None:
        open_goals = self._context.open_goals()
        if open_goals and self._steady() < self.deadline:
            return
        self.deadline = math.inf
        outcome, message, tip = self._end
        hidden = next((one for one in self.undecided if one not in message), "")
        if hidden:
            # Keeps the type, which marks a message with its place in the file.
            message = type(message)(f"{message}; {hidden}")
        self.result = RunResult(
            outcome=outcome,
            message=message,
            tip=tip,
            orphans=open_goals,
            ticks=self.ticks,
            overruns=self.overruns,
            duration_s=self._context.clock() - self._start,
        )
        self._phase = _Phase.ENDED
        self._context.close()

    def _tick(self, root: Behaviour) -> None:
        self.ticks += 1
        ticker = self._ticker(root)
        if self.period_s == math.inf:
            ticker.tick()
            return
        began = self._answered_at = self._steady()
        self._slowest, self._slowest_s = root, 0.0
        ticker.tick()
        now = self._steady()
        took = now - began
        if took > self.period_s:
            self.overruns += 1
            if now - self._answered_at > self._slowest_s:
                self._slowest, self._slowest_s = root, now - self._answered_at
            slowest = _path_of(self._slowest)
            self.overrun = Overrun(took_s=took, slowest=slowest, slowest_s=self._slowest_s)

    def _ticker(self, root: Behaviour) -> Ticker:
        ticker = self._tickers.get(root)
        if ticker is None:
            wrap_leaf = None if self.period_s == math.inf else self._timed
            ticker = self._tickers[root] = Ticker(
                root, on_change=self._report, on_visit=self._on_visit, wrap_leaf=wrap_leaf
            )
        return ticker

    def _timed(self, tick: Tick, leaf: Behaviour) -> Tick:
        clock = self._steady

        def timed() -> Status:
            status = tick()
            now = clock()
            if now - self._answered_at > self._slowest_s:
                self._slowest_s = now - self._answered_at
                self._slowest = leaf
            self._answered_at = now
            return status

        return timed

    def _report(self, node: Any) -> None:
        message = node.feedback_message
        if node.status is Status.FAILURE and is_undecided(message):
            self._report_undecided(message)
        values = self._take_values(node) if node.changed else ()
        change = StatusChange(node.spec.path, node.name, node.status, message, values)
        self.changes.append(change)

    def _take_values(self, node: Any) -> tuple[tuple[str, str], ...]:
        changed, node.changed = node.changed, {}
        some = list(changed.items())[: self._values_left]
        self._values_left -= len(some)
        return tuple((name, as_written(value)) for name, value in some)


def _path_of(node: Behaviour | None) -> str:
    spec = getattr(node, "spec", None)
    return spec.path if isinstance(spec, NodeSpec) else ""


def _reason(root: Behaviour) -> str:
    """Return the message of the deepest node on the failing path that has one."""
    message = ""
    node: Behaviour | None = root
    while node is not None:
        message = node.feedback_message or message
        failed = [child for child in node.children if child.status is Status.FAILURE]
        node = failed[-1] if failed else None
    return message or "the tree failed"
