# SPDX-License-Identifier: Apache-2.0
"""A run that notes what the outside told it, so that it can be repeated without the outside."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from random import Random

from bt_agents.engine.environment import Clock, Environment
from bt_agents.engine.run import Run, RunLimits, RunResult, StatusChange
from bt_agents.recording.recording_world import Note, Notebook, NotedContext
from bt_agents_core.field_types import Plain
from bt_agents_core.scene import Scene, SceneSpace, Vector
from bt_agents_language.model.specs import AgentSpec

FORMAT = 1
"""Number of the form of the notes; a replay takes no other one."""

MOST_CHARACTERS = 2_000_000
"""A run with longer notes is not recorded to its end; 45 min of 20 ticks a second do fit in."""

Sink = Callable[[int, str], None]
"""Takes the notes of one turn: number of the tick, one line of JSON."""


class RecordingRun(Run):
    """A :class:`Run` that notes, turn by turn, what the outside told it and what it asked for.

    A turn is a tick with the cancel before it. During one the outside stands still: clock, live
    scene and goals answer each time as they did first, a goal that is cancelled excepted. So one
    note a turn says all. A turn in which nothing new came is not noted at all.

    Notes are lines of JSON, with ``NaN`` and ``Infinity`` as Python writes them. The first holds
    what was known before: ``format``, ``agent``, ``version``, ``file``, ``seed``, ``limits``,
    ``parameters``, ``scene``, ``profile``, ``tunables``, ``live``, ``t``. The others:

    ============ ==================================================================================
    ``turn``     number of the turn, from 1
    ``quiet``    how many turns without a note there were right before; without it none
    ``changes``  how many nodes have changed in it; without it none
    ``t``        the trees' clock, when it was read and is another than before [s]; not when it was
                 only asked whether some time has come, and it has not
    ``s``        the same of the steady clock, which only the end of a run reads [s]
    ``live``     what is new in the live scene that was looked at
    ``tunables`` all of them, when one has changed
    ``do``       what the host did besides: ``["cancel", reason, with clean-up]`` or
                 ``["hurry", settle_s]`` each
    ``goals``    what is new about goals that were looked at: ``[number, field, value, whether it
                 came out only after a cancel in the same turn]``; goals are numbered as sent
    ``inbox``    messages that were taken: ``[number of the inbox, message]``
    ``plugins``  what behaviours of packages answered: ``[path, status, message]``
    ``out``      what was asked for: ``[kind, name, fields]``, with the error if it was refused
    ``end``      how the run has ended
    ``stopped``  why nothing more is noted
    ============ ==================================================================================

    Args:
        spec: See :class:`Run`, as for the other arguments of this name.
        seed: From which chance is drawn.
        version: Of the agent's file.
        sink: Takes the notes.
        most: Characters after which nothing more is noted.
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
        world: Environment,
        steady: Clock,
        seed: int,
        sink: Sink,
        limits: RunLimits | None = None,
        version: int = 0,
        most: int = MOST_CHARACTERS,
    ) -> None:
        limits = limits or RunLimits()
        notebook = self._notebook = Notebook(world, live, tunables, steady)
        self._sink = sink
        self._left = most
        self._noted = 0
        self._changed = 0
        super().__init__(
            spec,
            space=space,
            scene=scene,
            profile=profile,
            live=notebook.live,
            tunables=tunables,
            world=notebook,
            steady=notebook.steady,
            limits=limits,
            random=Random(seed),
            stopwatch=steady,
            plugins=notebook.plugin,
            context=NotedContext,
        )
        self._write(
            {
                "format": FORMAT,
                "agent": spec.name,
                "version": version,
                "file": spec.file,
                "seed": seed,
                "limits": asdict(limits),
                "parameters": list(space.names),
                "scene": asdict(scene),
                "profile": list(profile),
                **notebook.first(),
            }
        )

    def tick(self) -> list[StatusChange]:
        """Tick; see :meth:`Run.tick`."""
        notebook = self._notebook
        if not notebook.open and notebook.tuned != notebook.tunables:
            notebook.begin()
        changes = Run.tick(self)
        if changes or notebook.note or self.result is not None:
            self._changed += len(changes)
            self._close()
        else:
            notebook.turn += 1
        return changes

    def cancel(self, reason: str, *, clean_up: bool = True) -> list[StatusChange]:
        """Stop; see :meth:`Run.cancel`."""
        self._notebook.do("cancel", reason, clean_up)
        changes = super().cancel(reason, clean_up=clean_up)
        self._changed += len(changes)
        return changes

    def hurry(self, settle_s: float) -> None:
        """Wait less at the end; see :meth:`Run.hurry`."""
        self._notebook.do("hurry", settle_s)
        super().hurry(settle_s)

    def give_up(self, reason: str) -> RunResult:
        """End at once, as the engine has failed; see :meth:`Run.give_up`."""
        result = super().give_up(reason)
        self._stop(f"the engine has failed: {reason}")
        return result

    def _close(self) -> None:
        """Write down the turn."""
        note = self._notebook.end()
        turn = self._notebook.turn
        head: Note = {"turn": turn}
        if turn > self._noted + 1:
            head["quiet"] = turn - self._noted - 1
        if self._changed:
            head["changes"] = self._changed
        if self.result is not None:
            note["end"] = {**asdict(self.result), "outcome": self.result.outcome.value}
        self._noted = turn
        self._changed = 0
        self._write({**head, **note})

    def _write(self, note: Note) -> None:
        if self._notebook.closed:
            return
        try:
            line = _line(note)
        except (TypeError, ValueError, RecursionError) as error:
            self._stop(f"a value cannot be written down: {error}")
            return
        self._left -= len(line)
        if self._left < 0:
            self._stop("its notes got too long")
            return
        self._sink(self.ticks, line)

    def _stop(self, reason: str) -> None:
        if not self._notebook.closed:
            self._notebook.closed = True
            self._sink(self.ticks, json.dumps({"stopped": reason}))


def _line(note: Note) -> str:
    """Return a note as JSON; most say no more than the time, and are written much quicker."""
    if note.keys() <= _NUMBERS:
        return "{" + ",".join([f'"{key}":{value!r}' for key, value in note.items()]) + "}"
    return _JSON.encode(note)


def _plain(value: object) -> object:
    """Return what JSON has no word for as something that it has one for."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"there is a {type(value).__name__}, expected plain data")


_NUMBERS = {"turn", "quiet", "changes", "t", "s"}

_JSON = json.JSONEncoder(default=_plain, separators=(",", ":"), ensure_ascii=False)
