# SPDX-License-Identifier: Apache-2.0
"""All knobs of a host and where they stand: what may be set, undone, applied, and what is kept."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from concurrent.futures import Future as Job
from dataclasses import dataclass

from bt_agents.host.tuning.change_log import Journal
from bt_agents.host.tuning.history import (
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
    agent_of,
)
from bt_agents.host.tuning.overrides import Overrides
from bt_agents.host.tuning.presets import Presets, check_name
from bt_agents.host.tuning.tunable import Setting, TunableKind, TunableParameter, same, shown_value
from bt_agents_core.errors import Refused
from bt_agents_core.text import quote
from bt_agents_language.yaml.diagnostics import did_you_mean

FILE = "file"
"""Author of what a changed file has set."""

_SAVED = (TunableKind.TUNABLE, TunableKind.LEARNING_RATE)
_LONGEST_WORDS = 300
_FEW = 8


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where a knob stands at first.

    Attributes:
        value: Tuned before, or what the file says.
        overruled: The value tuned before that the file has overruled; None for none.
        why: Why it was overruled, in words.
    """

    value: Setting
    overruled: Setting | None = None
    why: str = ""


class ParameterStore:
    """Knobs that are checked and recorded here before anything acts on them.

    Args:
        journal: Where changes are written before they count; None keeps them in memory.
        presets: Values under names; only ``disk`` changes them.
        disk: Does one thing after the other, in a thread of its own.
        now: Returns the time [s since 1970].
        tell: Takes words for the log.

    Attributes:
        values: Where each knob stands, by name.
    """

    def __init__(
        self,
        journal: Journal | None,
        presets: Presets,
        disk: Executor,
        now: Callable[[], float],
        tell: Callable[[str], None],
    ) -> None:
        self.values: dict[str, Setting] = {}
        self.presets = presets
        self._knobs: dict[str, TunableParameter] = {}
        self._of_agents: dict[str, dict[str, TunableParameter]] = {}
        self._journal = journal
        self._disk = disk
        self._remembered = journal.remembered if journal is not None else Overrides()
        self._now = now
        self._tell = tell

    @property
    def history(self) -> TuningHistory:
        """The changes so far."""
        return self._remembered.history

    def start(self, knob: TunableParameter) -> Start:
        """Return where a knob is to stand that was not here before."""
        kept = self._remembered.kept.get(knob.name)
        if kept is None or knob.kind is TunableKind.PROFILE:
            return Start(value=knob.default)
        if same(kept.value, knob.default):
            return Start(value=knob.default)
        if not same(kept.default, knob.default):
            return Start(
                value=knob.default,
                overruled=kept.value,
                why=f"the file says {knob.written(knob.default)} now",
            )
        try:
            return Start(value=knob.check(kept.value))
        except Refused as refused:
            return Start(value=knob.default, overruled=kept.value, why=refused.reason)

    def has(self, name: str) -> bool:
        """Return whether there is a knob of this name."""
        return name in self._knobs

    def of(self, agent: str) -> Sequence[TunableParameter]:
        """Return the knobs of an agent; those of the whole host for the empty name."""
        return tuple(self._of_agents.get(agent, {}).values())

    def _put(self, knob: TunableParameter) -> None:
        self._knobs[knob.name] = knob
        self._of_agents.setdefault(knob.agent, {})[knob.name] = knob
        kept = self._remembered.kept.get(knob.name)
        if kept is not None and same(kept.value, knob.default):
            self._remembered.agree(knob.name)
            self._keep(lambda journal: journal.agree(knob.name), False)

    def add(self, knob: TunableParameter, value: Setting) -> None:
        """Take in a knob that stands at a value."""
        self._put(knob)
        self.values[knob.name] = value

    def remove(self, name: str) -> None:
        """Forget a knob; its history and what was tuned stay, for when it comes back."""
        knob = self._knobs.pop(name)
        del self.values[name]
        del self._of_agents[knob.agent][name]
        if not self._of_agents[knob.agent]:
            del self._of_agents[knob.agent]

    def replace(self, knob: TunableParameter) -> Setting:
        """Take in another version of a knob of the same type; return where it has to stand.

        A changed default was written by somebody, so it is the new value; otherwise the present
        one stays as far as it is possible.
        """
        old, value = self._knobs[knob.name], self.values[knob.name]
        self._put(knob)
        if not same(old.default, knob.default):
            return knob.default
        try:
            return knob.check(value)
        except Refused:
            return knob.default

    def follow(self, name: str, value: Setting) -> None:
        """Note a value that has changed by something else than tuning."""
        self.values[name] = value

    def check(self, values: Mapping[str, Setting]) -> None:
        """Check values that are to be set together.

        Raises:
            Refused: ``UNKNOWN_PARAMETER``, or as in :meth:`TunableParameter.check`.
        """
        for name, value in values.items():
            self.knob(name).check(value)

    def knob(self, name: str) -> TunableParameter:
        """Return a knob.

        Raises:
            Refused: ``UNKNOWN_PARAMETER``.
        """
        if name in self._knobs:
            return self._knobs[name]
        agent = agent_of(name)
        own = [one.name for one in self.of(agent)]
        hint = did_you_mean(name, own) if own else did_you_mean(agent, sorted(self._agents))
        alike = [one.name for one in self._knobs.values() if one.agent and one.key == name]
        if alike and not agent:
            more = f", and {len(alike) - _FEW} more" if len(alike) > _FEW else ""
            raise Refused(
                "UNKNOWN_PARAMETER", f"whose {quote(name)}? {', '.join(alike[:_FEW])}{more}"
            )
        if agent and own:
            what = f"{quote(agent)} has no {quote(name[len(agent) + 1 :])}"
        else:
            what = f"nothing here is called {quote(name)}"
        raise Refused("UNKNOWN_PARAMETER", f"{what}; {hint}".rstrip("; "))

    def read(self, names: Sequence[str], texts: Sequence[str]) -> Mapping[str, Setting]:
        """Return values as authors write them, by name.

        Raises:
            Refused: ``WRONG_LENGTH``, ``DUPLICATE``, or as in :meth:`knob` and
                :meth:`TunableParameter.read`.
        """
        if len(names) != len(texts) or not names:
            raise Refused(
                "WRONG_LENGTH",
                f"{len(names)} names and {len(texts)} values, expected as many of both, at least "
                "one",
            )
        values: dict[str, Setting] = {}
        for name, text in zip(names, texts, strict=True):
            if name in values:
                raise Refused("DUPLICATE", f"{name} stands twice; give it one value")
            values[name] = self.knob(name).read(text)
        return values

    def record(
        self, values: Mapping[str, Setting], cause: TuningCause, *, kept_or_refused: bool = True
    ) -> TuningRevision | None:
        """Let values come into force; when this returns, the change outlives the process.

        Args:
            values: They were checked.
            cause: Who wants them, and why.
            kept_or_refused: False lets them also come into force when they cannot be written.

        Returns:
            The revision; None when nothing differs and nothing is taken back.

        Raises:
            Refused: ``NOT_KEPT``; nothing is changed.
        """
        changes = tuple(
            TuningChange(name=name, before=self.values[name], after=value)
            for name, value in values.items()
            if self.values[name] != value
        )
        if not changes and cause.action is TuningAction.SET:
            return None
        return self._take(changes, cause, kept_or_refused)

    def sync(self) -> Job[None] | None:
        """Return the job after which the changes so far outlive a power cut; None without a file.

        Its error is an ``OSError``.
        """
        return self._journal.sync() if self._journal is not None else None

    def overrule(self, overruled: Mapping[str, Start]) -> TuningRevision | None:
        """Record that files have overruled values that were tuned before the start."""
        changes = tuple(
            TuningChange(name=name, before=start.overruled, after=start.value)
            for name, start in overruled.items()
            if start.overruled is not None
        )
        if not changes:
            return None
        reason = "; ".join(f"{name}: {start.why}" for name, start in overruled.items())
        return self._take(changes, TuningCause(author=FILE, reason=reason[:_LONGEST_WORDS]), False)

    def _take(
        self, changes: tuple[TuningChange, ...], cause: TuningCause, kept_or_refused: bool
    ) -> TuningRevision:
        revision = TuningRevision(
            number=self.history.revision + 1, stamp=self._now(), cause=cause, changes=changes
        )
        defaults = {
            change.name: self._knobs[change.name].default
            for change in changes
            if self._knobs[change.name].kind is not TunableKind.PROFILE
        }
        self._keep(lambda journal: journal.append(revision, defaults), kept_or_refused)
        self._remembered.take(revision, defaults)
        for change in changes:
            self.values[change.name] = change.after
        self._shorten()
        return revision

    def _keep(self, write: Callable[[Journal], None], kept_or_refused: bool) -> None:
        if self._journal is None:
            return
        try:
            write(self._journal)
        except Refused as refused:
            if kept_or_refused:
                raise
            self._tell(refused.reason)

    def _shorten(self) -> None:
        if self._journal is None or not self._journal.is_long:
            return
        try:
            self._journal.shorten(self._remembered)
        except OSError as error:
            self._tell(f"the file of tunings grows, it cannot be written anew: {error}")

    def undo(self, agents: Collection[str]) -> tuple[TuningRevision, Mapping[str, Setting]]:
        """Return what to undo next, and the values to set for it; as :meth:`TuningHistory.undo`.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``NOTHING_TO_UNDO``.
        """
        return self.history.undo(self._known(agents), self._possible)

    def redo(self, agents: Collection[str]) -> tuple[TuningRevision, Mapping[str, Setting]]:
        """Return what to redo next, and the values to set for it; as :meth:`TuningHistory.redo`.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``NOTHING_TO_REDO``.
        """
        return self.history.redo(self._known(agents), self._possible)

    def preset(self, name: str) -> tuple[Mapping[str, Setting], Sequence[str]]:
        """Return the values of a preset, and the names in it that do not exist any more.

        Raises:
            Refused: ``UNKNOWN_PRESET``, ``NOTHING_LEFT`` when none of its names exists, or as in
                :meth:`TunableParameter.read`.
        """
        preset = self.presets.get(name)
        values = {o: self._knobs[o].read(text) for o, text in preset.items() if o in self._knobs}
        if not values:
            raise Refused(
                "NOTHING_LEFT", f"preset {quote(name)} has no value of an agent that is here"
            )
        return values, [one for one in preset if one not in self._knobs]

    def save(self, name: str, agents: Collection[str]) -> tuple[int, Job[None]]:
        """Keep the tunables and learning rates of agents under a name.

        Those that are as in the file are kept too, so that the preset brings back all of them.

        Args:
            name: Of the preset.
            agents: Whose; empty for all.

        Returns:
            How many values, and the job that keeps them; its error is as in :meth:`Presets.save`.

        Raises:
            Refused: ``NOT_A_NAME`` or ``UNKNOWN_AGENT``.
        """
        check_name(name)
        wanted = self._known(agents)
        values = {
            knob.name: knob.written(self.values[knob.name])
            for knob in self._knobs.values()
            if knob.kind in _SAVED and (not wanted or knob.agent in wanted)
        }
        return len(values), self._disk.submit(self.presets.save, name, values)

    def forget(self, name: str) -> Job[None]:
        """Remove a preset; the error of the job is as in :meth:`Presets.forget`."""
        return self._disk.submit(self.presets.forget, name)

    @property
    def _agents(self) -> Collection[str]:
        return self._of_agents.keys() - {""}

    def _known(self, agents: Collection[str]) -> Collection[str]:
        for agent in agents:
            if agent not in self._agents:
                hint = did_you_mean(agent, sorted(self._agents))
                raise Refused("UNKNOWN_AGENT", f"no agent {quote(agent)} here; {hint}")
        return set(agents)

    def _possible(self, name: str, value: Setting) -> bool:
        if name not in self._knobs:
            return False
        try:
            self._knobs[name].check(value)
        except Refused:
            return False
        return True

    def words(self, changes: Iterable[TuningChange]) -> str:
        """Return changes in words: ``attentive_guide.patience: 8 s → 12 s``."""
        return ", ".join(
            f"{one.name}: {self.written(one.name, one.before)} → "
            f"{self.written(one.name, one.after)}"
            for one in changes
        )

    def written(self, name: str, value: Setting) -> str:
        """Return a value for people, also of a knob that is gone."""
        knob = self._knobs.get(name)
        if knob is not None:
            return shown_value(knob, value)
        return str(value).lower() if isinstance(value, bool) else f"{value}"

    def close(self) -> None:
        """Let others have the file."""
        if self._journal is not None:
            self._journal.close()


def words_of(text: str, what: str, longest: int = _LONGEST_WORDS) -> str:
    """Return words from outside that can be shown in one line.

    Raises:
        Refused: ``NOT_WORDS``.
    """
    if len(text) > longest or not text.isprintable():
        bad = next((one for one in text if not one.isprintable()), "")
        found = f", with the character {bad!r}" if bad else f", {len(text)} characters"
        raise Refused(
            "NOT_WORDS",
            f"{what} is {quote(text)}{found}; expected one line of at most {longest} visible "
            "characters",
        )
    return text
