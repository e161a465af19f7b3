# SPDX-License-Identifier: Apache-2.0
"""Store of a host's tunable parameters: values, undo and redo, presets, restarts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from concurrent.futures import Future as Job

from bt_agents.host.agent_registry import HostedAgent
from bt_agents.host.tuning.change_log import ChangeLog
from bt_agents.host.tuning.history import (
    FoundRevision,
    TuningAction,
    TuningCause,
    TuningChange,
    TuningHistory,
    TuningRevision,
    agent_of,
)
from bt_agents.host.tuning.presets import Presets, check_name
from bt_agents.host.tuning.tunable import (
    TICK_RATE,
    Setting,
    TunableKind,
    TunableParameter,
    same,
    shown_value,
)
from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean

FILE = "file"
"""Author of values that a changed file has set."""

_LONGEST_LINE = 300
_FEW = 8


class ParameterStore:
    """Tunable parameters; checks and logs each change before it takes effect.

    The :class:`HostedAgent` holds the values of an agent, and its tree reads them there.

    Args:
        members: The agents of the host by name.
        log: Log of the changes, written before they count; None for none.
        presets: The named presets; only ``disk`` changes them.
        disk: Executor with a single thread for the disk.
        now: Returns the time [s since 1970].
        report: Logs a line of the host.
        changed: Called with the parameters whose values have changed, once for all of them.
    """

    def __init__(
        self,
        members: Mapping[str, HostedAgent],
        log: ChangeLog | None,
        presets: Presets,
        disk: Executor,
        now: Callable[[], float],
        report: Callable[[str], None],
        changed: Callable[[Collection[TunableParameter]], None],
    ) -> None:
        self._members = members
        self._tick_rate: Setting = TICK_RATE.default
        self.presets = presets
        self._parameters: dict[str, TunableParameter] = {}
        self._of_agents: dict[str, dict[str, TunableParameter]] = {}
        self._log = log
        self._disk = disk
        self.history = log.history if log is not None else TuningHistory()
        self._now = now
        self._report = report
        self._changed = changed

    def start(self, parameter: TunableParameter) -> tuple[Setting, str]:
        """Return the initial value of a new parameter, and why it is not the tuned one, if so."""
        default = parameter.default
        override = self.history.overrides.get(parameter.name)
        if override is None or same(override.value, default):
            return default, ""
        if not same(override.default, default):
            return default, f"the file says {parameter.format(default)} now"
        try:
            return parameter.check(override.value), ""
        except Refused as refused:
            return default, refused.reason

    def has(self, name: str) -> bool:
        """Return whether a parameter of this name exists."""
        return name in self._parameters

    def of(self, agent: str) -> Sequence[TunableParameter]:
        """Return the parameters of an agent; an empty name means the whole host."""
        return tuple(self._of_agents.get(agent, {}).values())

    def _put(self, parameter: TunableParameter) -> None:
        self._parameters[parameter.name] = parameter
        self._of_agents.setdefault(parameter.agent, {})[parameter.name] = parameter
        override = self.history.overrides.get(parameter.name)
        if override is not None and same(override.value, parameter.default):
            kept = self.history.without_override(parameter.name)
            self._keep(kept, must_be_stored=False)

    def add(self, parameter: TunableParameter, value: Setting) -> None:
        """Add a parameter with its value."""
        self._put(parameter)
        self._assign(parameter, value)

    def remove(self, name: str) -> None:
        """Remove a parameter; its history and override stay in case it returns."""
        parameter = self._parameters.pop(name)
        if parameter.kind is TunableKind.TUNABLE and parameter.agent in self._members:
            del self._members[parameter.agent].tunables[parameter.key]
        del self._of_agents[parameter.agent][name]
        if not self._of_agents[parameter.agent]:
            del self._of_agents[parameter.agent]

    def replace(self, parameter: TunableParameter) -> Setting:
        """Replace a parameter by another version of the same type; return its new value.

        A changed default is deliberate, so it becomes the value; otherwise the current value stays
        if it is possible.
        """
        old, value = self._parameters[parameter.name], self.value(parameter.name)
        self._put(parameter)
        if not same(old.default, parameter.default):
            return parameter.default
        try:
            return parameter.check(value)
        except Refused:
            return parameter.default

    def value(self, name: str) -> Setting:
        """Return the current value of a parameter."""
        parameter = self._parameters[name]
        match parameter.kind:
            case TunableKind.TUNABLE:
                return self._members[parameter.agent].tunables[parameter.key]
            case TunableKind.LEARNING_RATE:
                return self._members[parameter.agent].learning_rate
        return self._tick_rate

    def _assign(self, parameter: TunableParameter, value: Setting) -> None:
        match parameter.kind:
            case TunableKind.TUNABLE:
                self._members[parameter.agent].tunables[parameter.key] = value
            case TunableKind.LEARNING_RATE:
                self._members[parameter.agent].learning_rate = float(value)
            case TunableKind.TICK_RATE:
                self._tick_rate = value

    def parameter(self, name: str) -> TunableParameter:
        """Return the parameter of this name.

        Raises:
            Refused: ``UNKNOWN_PARAMETER``.
        """
        if name in self._parameters:
            return self._parameters[name]
        agent = agent_of(name)
        own = [one.name for one in self.of(agent)]
        hint = did_you_mean(name, own) if own else did_you_mean(agent, sorted(self._agents))
        alike = [one.name for one in self._parameters.values() if one.agent and one.key == name]
        if alike and not agent:
            more = f", and {len(alike) - _FEW} more" if len(alike) > _FEW else ""
            raise Refused(
                RefusalCode.UNKNOWN_PARAMETER,
                f"whose {quote(name)}? {', '.join(alike[:_FEW])}{more}",
            )
        if agent and own:
            what = f"{quote(agent)} has no {quote(name[len(agent) + 1 :])}"
        else:
            what = f"nothing here is called {quote(name)}"
        raise Refused(RefusalCode.UNKNOWN_PARAMETER, f"{what}; {hint}".rstrip("; "))

    def read(self, names: Sequence[str], texts: Sequence[str]) -> Mapping[str, Setting]:
        """Return the values of texts as authors write them, by name.

        Raises:
            Refused: ``WRONG_LENGTH``, ``DUPLICATE``, or as in :meth:`parameter` and
                :meth:`TunableParameter.read`.
        """
        if len(names) != len(texts) or not names:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{len(names)} names and {len(texts)} values, expected as many of both, at least "
                "one",
            )
        values: dict[str, Setting] = {}
        for name, text in zip(names, texts, strict=True):
            if name in values:
                raise Refused(RefusalCode.DUPLICATE, f"{name} stands twice; give it one value")
            values[name] = self.parameter(name).read(text)
        return values

    def check_unchanged(self, names: Collection[str], seen: int) -> None:
        """Check that no value has changed since a revision.

        Raises:
            Refused: ``CHANGED_MEANWHILE``, with who changed it last.
        """
        shown = self.history.shown
        for revision, change in ((one, o) for one in reversed(shown) for o in one.changes):
            if change.name in names and revision.number > seen:
                before, after = (
                    self.format_value(change.name, one) for one in (change.before, change.after)
                )
                raise Refused(
                    RefusalCode.CHANGED_MEANWHILE,
                    f"{change.name} was changed from {before} to {after} by "
                    f"{revision.cause.author} (revision {revision.number}), expected no change "
                    f"after revision {seen}; look at it, and set it again",
                )
        newest = self.history.revision
        if seen > newest or (shown and seen < shown[0].number - 1):
            raise Refused(
                RefusalCode.CHANGED_MEANWHILE,
                f"revision {seen} is not known here any more, the last one is {newest}; look at "
                "the values, and set them again",
            )

    def set(
        self, values: Mapping[str, Setting], cause: TuningCause, *, must_be_stored: bool = True
    ) -> TuningRevision | None:
        """Set values together or not at all; they survive the end of the process.

        Values that need not be stored also come into force if they cannot be written.

        Returns:
            The revision; None if nothing differs and nothing is undone.

        Raises:
            Refused: ``UNKNOWN_PARAMETER``, or as in :meth:`TunableParameter.check` and
                :meth:`ChangeLog.write`; nothing is changed.
        """
        for name, value in values.items():
            self.parameter(name).check(value)
        changes = tuple(
            TuningChange(name=name, before=self.value(name), after=value)
            for name, value in values.items()
            if self.value(name) != value
        )
        if not changes and cause.action is TuningAction.SET:
            return None
        return self._take(changes, cause, must_be_stored)

    def flush(self) -> Job[None] | None:
        """Return the job after which all changes survive a power cut; None without a file.

        Its error is an ``OSError``.
        """
        return self._log.flush() if self._log is not None else None

    def overrule(self, reasons: Mapping[str, str]) -> TuningRevision | None:
        """Record that files have overruled tuned values; ``reasons`` are by name."""
        changes = tuple(
            TuningChange(
                name=name, before=self.history.overrides[name].value, after=self.value(name)
            )
            for name in reasons
        )
        if not changes:
            return None
        reason = "; ".join(f"{name}: {why}" for name, why in reasons.items())
        return self._take(changes, TuningCause(author=FILE, reason=reason[:_LONGEST_LINE]), False)

    def _take(
        self, changes: tuple[TuningChange, ...], cause: TuningCause, must_be_stored: bool
    ) -> TuningRevision:
        revision = TuningRevision(
            number=self.history.revision + 1, stamp=self._now(), cause=cause, changes=changes
        )
        defaults = {change.name: self._parameters[change.name].default for change in changes}
        history = self.history.with_revision(revision, defaults)
        self._keep(history, must_be_stored=must_be_stored)
        changed = [self._parameters[change.name] for change in changes]
        for parameter, change in zip(changed, changes, strict=True):
            self._assign(parameter, change.after)
        self._changed(changed)
        return revision

    def _keep(self, history: TuningHistory, *, must_be_stored: bool) -> None:
        if self._log is not None:
            try:
                self._log.write(history)
            except Refused as refused:
                if must_be_stored:
                    raise
                self._report(refused.reason)
        self.history = history

    def find(self, action: TuningAction, agents: Collection[str]) -> FoundRevision:
        """Return what to undo or redo next; see :meth:`TuningHistory.find`.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``NOTHING_TO_UNDO`` or ``NOTHING_TO_REDO``.
        """
        return self.history.find(action, self._known(agents), self._possible)

    def preset(self, name: str) -> tuple[Mapping[str, Setting], Sequence[str]]:
        """Return the values of a preset, and the names in it that no longer exist.

        Raises:
            Refused: ``UNKNOWN_PRESET``, ``NOTHING_LEFT`` if none of its names exists, or as in
                :meth:`TunableParameter.read`.
        """
        preset = self.presets.get(name)
        values = {
            key: self._parameters[key].read(text)
            for key, text in preset.values.items()
            if key in self._parameters
        }
        if not values:
            raise Refused(
                RefusalCode.NOTHING_LEFT,
                f"preset {quote(name)} has no value of an agent that is here",
            )
        return values, [one for one in preset.values if one not in self._parameters]

    def save(self, name: str, agents: Collection[str]) -> tuple[int, Job[None]]:
        """Save the tunables and learning rates of agents (of all, if empty) as a preset.

        Values equal to the file are saved too, so that the preset restores all values.

        Returns:
            The number of values and the job that saves them, as in :meth:`Presets.save`.

        Raises:
            Refused: ``BAD_NAME`` or ``UNKNOWN_AGENT``.
        """
        check_name(name)
        wanted = self._known(agents)
        values = {
            parameter.name: parameter.format(self.value(parameter.name))
            for parameter in self._parameters.values()
            if parameter.agent and (not wanted or parameter.agent in wanted)
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
                raise Refused(RefusalCode.UNKNOWN_AGENT, f"no agent {quote(agent)} here; {hint}")
        return set(agents)

    def _possible(self, name: str, value: Setting) -> bool:
        try:
            self._parameters[name].check(value)
        except (KeyError, Refused):
            return False
        return True

    def format_changes(self, changes: Iterable[TuningChange]) -> str:
        """Return changes as one line: ``attentive_guide.patience: 8 s → 12 s``."""
        return ", ".join(
            f"{one.name}: {self.format_value(one.name, one.before)} → "
            f"{self.format_value(one.name, one.after)}"
            for one in changes
        )

    def format_value(self, name: str, value: Setting) -> str:
        """Return a value for people, even of a parameter that is gone."""
        parameter = self._parameters.get(name)
        if parameter is not None:
            return shown_value(parameter, value)
        return str(value).lower() if isinstance(value, bool) else f"{value}"

    def close(self) -> None:
        """Release the file."""
        if self._log is not None:
            self._log.close()


def checked_line(text: str, what: str, longest: int = _LONGEST_LINE) -> str:
    """Return a text from outside, checked to be printable on one line.

    Raises:
        Refused: ``BAD_TEXT``.
    """
    if len(text) > longest or not text.isprintable():
        bad = next((one for one in text if not one.isprintable()), "")
        found = f", with the character {bad!r}" if bad else f", {len(text)} characters"
        raise Refused(
            RefusalCode.BAD_TEXT,
            f"{what} is {quote(text)}{found}; expected one line of at most {longest} visible "
            "characters",
        )
    return text
