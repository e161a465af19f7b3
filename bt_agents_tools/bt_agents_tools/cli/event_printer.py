# SPDX-License-Identifier: Apache-2.0
"""Printer of a system's events, line by line, for a terminal."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text

from bt_agents_core.log_budget import LogBudget
from bt_agents_core.ros_names import LONGEST_NAME
from bt_agents_core.scene import SceneSpace
from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.stop_cause import StopCause, StoppedBy, stopper
from bt_agents_core.text import ellipsize, filled_name, format_known, join_first
from bt_agents_tools.cli.formatting import (
    KINDS,
    OUTCOMES,
    code_text,
    constant_text,
    counted,
    print_line,
    values_text,
)

LONGEST_TEXT = 400
"""Maximum number of characters to show of an event."""

MOST_LINES = 2_000
"""Maximum number of lines in :data:`LINES_S`; further ones are dropped."""

LINES_S = 5.0

MOST_COUNTED = 10_000
"""Number of latest runs and feedbacks for the summary."""

_REMEMBERED = 1_000
"""Maximum number of agents, hosts and nodes to remember data about."""

_STATUS = {"running": "[yellow]▶", "success": "[green]✔", "failure": "[red]✘"}
_STATUSES = ("RUNNING", "SUCCESS", "FAILURE")
_MOOD_STEP = 0.25
_SHOWN_BY_RUN = ("SUCCEEDED", "FAILED", "CANCELLED", "PREEMPTED", "NO_BIDS")


class EventPrinter:
    """Listener of an observer that prints events and counts them for the summary.

    It prints and remembers a bounded amount, however long and many the messages are.
    """

    def __init__(
        self, console: Console, space: SceneSpace, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._console = console
        self._space = space
        self._budget = LogBudget(MOST_LINES, LINES_S, clock)
        self._mood: float | None = None
        self._start: dict[str, Sequence[float]] = {}
        self._now: dict[str, Sequence[float]] = {}
        self._scene_id = ""
        self._names = SceneLabels()
        self._queued = 0
        self._awaited: Sequence[str] = ()
        self._refused: Sequence[str] = ()
        self._under_way = ""
        self._stopping = False
        self._started = ("", 0)
        self._filled_names: dict[str, str] = {}
        self._tuned: dict[str, int] = {}
        self.runs: deque[tuple[str, str]] = deque(maxlen=MOST_COUNTED)
        self.rounds = 0
        self.unanswered = 0
        self.feedbacks: deque[tuple[str, str]] = deque(maxlen=MOST_COUNTED)
        self.takeovers = 0
        self.preemptions = 0
        self.remarks = 0

    def profiles(self, profiles: Mapping[str, Sequence[float]]) -> None:
        """Store the profiles before the first event, for the summary."""
        for agent, profile in profiles.items():
            self._start.setdefault(agent, profile)
            self._now.setdefault(agent, profile)

    def visitor(self, label: str) -> None:
        if label and (allowed := self._budget.line(ellipsize(label, LONGEST_TEXT))):
            self._console.print()
            self._console.rule(f"[bold]{escape(allowed)}", align="left", style="cyan")

    def remark(self, text: str) -> None:
        self.remarks += 1
        self._line("visitor", f"[yellow]{escape(text)}[/]")

    def scene(self, message: Any) -> None:
        self._scene_id = message.scene_id
        self._names.add(message)
        urgent = "[bold]urgent[/] " if message.urgent else ""
        label = f"[bold]{escape(message.label)}[/]: " if message.label else ""
        self._line("scene", urgent + label + self._values(message))

    def market(self, message: Any) -> None:
        for host in message.refused_hosts:
            if host not in self._refused:
                self._line("market", f"[yellow]refuses[/] {escape(host)}")
        self._refused = list(message.refused_hosts)
        awaited = list(message.awaited_hosts)
        if awaited and awaited != self._awaited:
            hosts = escape(join_first(awaited))
            self._line("scene", f"[yellow]{message.queued} in line[/] wait for {hosts} to be back")
        elif message.queued > self._queued:
            busy = f"{message.agent} has the robot" if message.agent else "another is under way"
            if message.state == message.IDLE:
                busy = message.message
            count = f" as the last of {message.queued}" if message.queued > 1 else ""
            self._line("scene", f"[dim]waits in line{count}: {escape(busy)}[/]")
        self._queued, self._awaited = message.queued, awaited

    def live(self, message: Any) -> None:
        mood = next((v.value for v in message.values if v.name == self._space.mood), math.nan)
        if math.isnan(mood) or self._mood is None or abs(mood - self._mood) < _MOOD_STEP:
            return
        style, verb = ("red", "falls") if mood < self._mood else ("green", "rises")
        self._line(
            "mood", f"[{style}]{verb} from {format_known(self._mood)} to {format_known(mood)}[/]"
        )
        self._mood = mood

    def auction(self, message: Any) -> None:
        self.rounds += 1
        if message.follows or message.scene.scene_id != self._scene_id:
            self.scene(message.scene)
        head = f"bid {message.round}"
        for bid in message.ranking:
            style = "bold" if bid.agent == message.winner else "dim"
            total, equals, terms = escape(bid.calculation).partition(" =")
            text = f"[{style}]{escape(f'{bid.agent:<22}')} {total}[/][dim]{equals}{terms}[/]"
            self._line(head, text)
        for bid in message.refused:
            self._line(head, f"[dim]{escape(f'{bid.agent:<22} –  {bid.reason}')}[/]")
        if message.outcome in (message.PREEMPTS, message.WAITS):
            stops = message.outcome == message.PREEMPTS
            title = "[bold yellow]the run is stopped[/]" if stops else "[dim]the run goes on[/]"
            self._line("challenge", f"{title}  {self._named(message.reason)}")
            self.preemptions += stops
            return
        self.takeovers += bool(message.follows and message.winner)
        style = "bold green" if message.winner else "bold yellow"
        title = f"{escape(message.winner)} wins" if message.winner else "nobody"
        self._line("award", f"[{style}]{title}[/]  {self._named(message.reason)}")
        self.unanswered += not message.winner

    def run(self, message: Any) -> None:
        agent = escape(message.agent)
        if message.event == message.STARTED:
            moods = (v.value for v in message.scene.values if v.name == self._space.mood)
            self._mood = next((mood for mood in moods if not math.isnan(mood)), None)
            self._starts(message)
        elif message.event == message.CANCELLING:
            self._stopping = True
            reason = self._named(message.message)
            by = StoppedBy.of(message.stopped_by)
            who = f" ({stopper(StopCause.BY_MARKET, by)})" if by else ""
            self._line("run", f"[yellow]stopping {agent}{who}:[/] {reason}")
        elif message.event == message.REFUSED:
            self._line("run", f"[yellow]{agent}: {self._named(message.message)}[/]")
        else:
            self._mood = None
            self._under_way = ""
            outcome = constant_text(message, message.outcome, OUTCOMES)
            self.runs.append((ellipsize(message.agent, LONGEST_NAME), outcome))
            style = {"succeeded": "green", "cancelled": "yellow"}.get(outcome, "red")
            # The last count of a departed host is unknown.
            ticks = f", {message.ticks} ticks" if message.ticks else ""
            orphans = escape(", ".join(message.orphans))
            self._line(
                "run",
                f"[{style}]{agent} {outcome}[/] after "
                f"{message.duration_s:.1f} s{ticks}: {self._named(message.message)}"
                + (f" [red]orphans: {orphans}[/]" if orphans else ""),
            )

    def _starts(self, message: Any) -> None:
        """Print a start once, because the first tick may arrive before the market's message."""
        if self._started != (message.epoch, message.round):
            self._started = (message.epoch, message.round)
            self._under_way, self._stopping = message.agent, False
            self._filled_names.clear()
            self._line("run", f"{escape(message.agent)} starts")

    def end(self, message: Any) -> None:
        if message.code not in _SHOWN_BY_RUN:
            scene = escape(self._names.name_of(message.scene_id))
            title = f"'{scene}' [yellow]{escape(code_text(message.code))}:[/]"
            self._line("scene", f"{title} {self._named(message.message)}")

    def tree(self, message: Any) -> None:
        # First the ended nodes in order of ending, then the begun ones, parents before children.
        ended = [change for change in message.changes if change.status != change.RUNNING]
        begun = [change for change in message.changes if change.status == change.RUNNING]
        if message.tick == 1:
            self._starts(message)
        cleans_up = any(change.path.startswith("on_cancel") for change in message.changes)
        if self._under_way == message.agent and not self._stopping and cleans_up:
            self._stopping = True
            who = escape(message.agent)
            self._line("run", f"[yellow]stopping {who}:[/] its host hears no market")
        for change in [*ended, *sorted(begun, key=lambda change: _tree_order(change.path))]:
            decorator = "@" in change.path.rpartition("/")[2]
            if change.status == change.INVALID or (decorator and change.status != change.FAILURE):
                continue
            depth = change.path.count("/")
            name, details = self._filled(change)
            details = f" [dim]{escape(details)}[/]" if details else ""
            if change.values:
                details += f" [cyan]{escape(values_text(change.values))}[/]"
            status = _STATUS[constant_text(change, change.status, _STATUSES)]
            self._line(
                "tree",
                f"[dim]{message.tick:>4}[/] {'  ' * depth}{status}[/] {escape(name)}{details}",
            )

    def _filled(self, change: Any) -> tuple[str, str]:
        """Return the name and message of a node; known values replace references in the name.

        While a skill or a ``wait`` runs, its message holds the values of these references.
        """
        if change.status != change.RUNNING:
            return self._filled_names.pop(change.path, change.name), change.message
        filled = filled_name(change.name, change.message)
        if filled == change.name:
            return change.name, change.message
        _remember(self._filled_names, change.path, filled)
        return filled, ""

    def act(self, text: str) -> None:
        self._line("robot", f"[bold magenta]{escape(text)}[/]")

    def feedback(self, message: Any) -> None:
        kind = constant_text(message, message.kind, KINDS)
        agent = ellipsize(message.agent, LONGEST_NAME)
        self.feedbacks.append((agent, kind))
        who = escape(message.agent)
        if message.layer:
            who += f" for {escape(message.layer)}"
        elif agent in self._start or len(self._start) < _REMEMBERED:
            self._start.setdefault(agent, list(message.before))
            self._now[agent] = list(message.after)
        style = {"positive": "green", "negative": "red"}.get(kind, "blue")
        self._line(
            "feedback",
            f"[{style}]{kind}[/] for {escape(message.agent)} by {escape(message.source)}"
            + (f": {escape(message.reason)}" if message.reason else ""),
        )
        self._line(
            "profile",
            f"{who} {_vector(message.before)} → [bold]{_vector(message.after)}[/] "
            f"[dim](revision {message.revision})[/]",
        )

    def tunings(self, message: Any) -> None:
        # The first message of a host has only changes from before.
        last = self._tuned.get(message.host, message.revision)
        _remember(self._tuned, message.host, message.revision)
        for one in message.tunings:
            if one.revision > last:
                reason = f": {one.reason}" if one.reason else ""
                self._line(
                    "tuned",
                    f"[bold]{escape(f'{one.name}: {one.before} → {one.after}')}[/] "
                    f"[dim]({escape(one.author + reason)}, revision {one.revision})[/]",
                )

    def agents_changed(self, text: str, is_error: bool) -> None:
        self._line("agents", f"[{'red' if is_error else 'bold'}]{escape(text)}[/]")

    def summary(self) -> None:
        """Print counts of all events, and every profile before and after."""
        self._console.print()
        self._console.rule("[bold]summary", align="left", style="cyan")
        names = ", ".join(self._space.profiles.names)
        self._row("agent", "runs", "feedback", f"profile ({names})")
        for agent in sorted(self._start):
            runs = [outcome for name, outcome in self.runs if name == agent]
            outcomes = ", ".join(runs) or "–"
            given = [kind for name, kind in self.feedbacks if name == agent]
            before, after = self._start[agent], self._now[agent]
            moved = _vector(before) + ("" if before == after else f" → {_vector(after)}")
            self._row(agent, outcomes, ", ".join(given) or "–", moved)
        text = (
            f"{counted(self.rounds, 'round')}, {counted(len(self.runs), 'run')}, {self.takeovers} "
            f"taken over by another agent, {len(self.feedbacks)} times feedback, "
            f"{counted(self.unanswered, 'scene')} without a bid"
        )
        if self.preemptions:
            text += f", {counted(self.preemptions, 'run')} stopped for another scene"
        self._console.print(text, soft_wrap=True)

    def _named(self, text: str) -> str:
        return escape(self._names.with_names(text))

    def _values(self, message: Any) -> str:
        if not message.person and all(math.isnan(v.value) for v in message.values):
            return "no person, nothing else is known"
        parts = []
        for value in message.values:
            parameter = next((p for p in self._space.parameters if p.name == value.name), None)
            name = escape(value.name)
            if math.isnan(value.value):
                parts.append(f"{name} [yellow]missing[/]")
            else:
                label = parameter.labels.get(value.value, "") if parameter else ""
                known = format_known(value.value)
                parts.append(f"{name} {known}" + (f" ({escape(label)})" if label else ""))
        return ", ".join(parts) + ("" if message.person else ", no person")

    def _row(self, agent: str, runs: str, feedback: str, profile: str) -> None:
        row = f"{agent:<22} {runs:<21} {feedback:<19} {profile}"
        self._console.print(row, markup=False, highlight=False, soft_wrap=True)

    def _line(self, what: str, text: str) -> None:
        if not (allowed := self._budget.line(what)):
            return
        body = Text.from_markup(text)
        body.truncate(LONGEST_TEXT, overflow="ellipsis")
        body.append(allowed.removeprefix(what))
        print_line(self._console, f"[cyan]{what:>9}[/]  ", body)


def _remember(store: dict[str, Any], key: str, value: Any) -> None:
    """Store a value under a key; drop the oldest one to make room."""
    store.pop(key, None)
    store[key] = value
    if len(store) > _REMEMBERED:
        del store[next(iter(store))]


def _tree_order(path: str) -> list[int]:
    """Return a sort key for the path of a node that puts parents before children."""
    numbers = (part.partition(".")[0] for part in path.split("/"))
    return [int(number) if number.isdecimal() else 0 for number in numbers]


def _vector(values: Sequence[float]) -> str:
    return "[" + ", ".join(map(format_known, values)) + "]"
