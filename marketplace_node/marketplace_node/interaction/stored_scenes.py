# SPDX-License-Identifier: Apache-2.0
"""Stored scenes: what a later start of the market must know about scenes without an end.

The open goals of hosts are stored with them, because no other process knows these once their host
has died.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from bt_agents_core.errors import Refused
from bt_agents_core.open_goals import OpenGoal
from bt_agents_core.person_facts import facts
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import MISSING, Origin, Scene, SceneSpace, SceneValue, finite_or_none
from bt_agents_core.stop_cause import StoppedBy
from marketplace_node.effects import EarlierRun, SceneEnded
from marketplace_node.hosts.goal_takeover import StoredGoals
from marketplace_node.hosts.host_effects import Effect, RunGoal
from marketplace_node.operator_overrides import ActiveOverride
from marketplace_node.outcomes import RunOutcome

_PLAIN: Mapping[str, type] = {
    "scene_id": str,
    "label": str,
    "person": bool,
    "urgent": bool,
    "person_id": str,
    "place": str,
    "persons": int,
    "visits": int,
    "stamp": float,
}
"""Fields of a scene that are stored unchanged, with their types."""

_NUMBERS = ("value", "age_s", "std", "confidence")
"""Numeric fields of a value; null means NaN."""

_INTEGERS = ("round", "agent_id")


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """Last run for a stored scene.

    Attributes:
        epoch: The market of the run.
        code: How it ended, as a code for the end of the scene; empty while unknown.
        message: The same in words.
    """

    epoch: str
    round: int
    agent: str
    agent_id: int = 0
    host: str
    instance: str
    code: str = ""
    message: str = ""


_Stored = TypeVar("_Stored", ActiveOverride, StoredRun, SceneEnded, RunGoal)


@dataclass(frozen=True, kw_only=True)
class StoredScene:
    """Scene without an end; without a run it is still queued."""

    scene: Scene
    award: ActiveOverride | None = None
    run: StoredRun | None = None


@dataclass(frozen=True, kw_only=True)
class StoreScenes(Effect):
    """Store all scenes without an end, next first, and the ids of all scenes taken so far.

    Attributes:
        open_goals: Open goals of registered hosts, and goals that are being cancelled.
        hosts: The live hosts.
        ends: Ends of scenes to be announced next.
        run_ends: Ends of runs to be announced next.
        at_once: Whether to store it before the next effect; False where it only says that ends
            were announced.
    """

    scenes: tuple[StoredScene, ...]
    taken: tuple[str, ...]
    open_goals: tuple[StoredGoals, ...] = ()
    hosts: tuple[str, ...] = ()
    ends: tuple[SceneEnded, ...] = ()
    run_ends: tuple[EarlierRun, ...] = ()
    at_once: bool = True


def format_scenes(effect: StoreScenes) -> str:
    """Return the text to store, for :func:`read_scenes`."""
    stored = {
        "scenes": [
            {
                "scene": _scene_to_dict(one.scene),
                "award": vars(one.award) if one.award is not None else None,
                "run": vars(one.run) if one.run is not None else None,
            }
            for one in effect.scenes
        ],
        "taken": effect.taken,
        "open_goals": [
            {
                "host": one.host,
                "instance": one.instance,
                "goals": [[goal.path, goal.action, goal.goal_id.hex()] for goal in one.goals],
            }
            for one in effect.open_goals
        ],
        "hosts": effect.hosts,
        "ends": [vars(one) for one in effect.ends],
        "run_ends": [
            {**vars(one), "scene": _scene_to_dict(one.scene), "goal": vars(one.goal)}
            for one in effect.run_ends
        ],
    }
    return json.dumps(stored, ensure_ascii=False)


def read_scenes(text: str, space: SceneSpace) -> StoreScenes:
    """Return what :func:`format_scenes` wrote.

    Raises:
        Refused: ``MALFORMED``.
    """
    try:
        stored = json.loads(text)
        return StoreScenes(
            scenes=tuple(
                StoredScene(
                    scene=_scene_from_dict(one["scene"], space),
                    award=_checked(ActiveOverride, one["award"]),
                    run=_checked(StoredRun, one["run"]),
                )
                for one in stored["scenes"]
            ),
            taken=tuple(_typed(one, str) for one in stored["taken"]),
            open_goals=tuple(_goals_from_dict(one) for one in stored.get("open_goals", ())),
            hosts=tuple(_typed(one, str) for one in stored.get("hosts", ())),
            ends=tuple(_required(SceneEnded, one) for one in stored.get("ends", ())),
            run_ends=tuple(_run_end_from_dict(one, space) for one in stored.get("run_ends", ())),
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, Refused) as error:
        raise Refused(
            RefusalCode.MALFORMED,
            f"the stored scenes cannot be read ({error}), so those that waited have no end; "
            "announce them again",
        ) from None


def _scene_to_dict(scene: Scene) -> dict[str, Any]:
    return {
        **{name: getattr(scene, name) for name in _PLAIN},
        "remembered": dict(scene.remembered),
        "values": [
            {
                "name": value.name,
                "origin": int(value.origin),
                "source": value.source,
                **{name: finite_or_none(getattr(value, name)) for name in _NUMBERS},
            }
            for value in scene.values
        ],
    }


def _scene_from_dict(stored: Mapping[str, Any], space: SceneSpace) -> Scene:
    values = [
        SceneValue(
            name=_typed(one["name"], str),
            origin=Origin(one["origin"]),
            source=_typed(one["source"], str),
            **{
                name: MISSING if one[name] is None else _typed(one[name], float)
                for name in _NUMBERS
            },
        )
        for one in stored["values"]
    ]
    return Scene(
        values=space.scene(values),
        remembered=facts(stored["remembered"].items()),
        **{name: _typed(stored[name], kind) for name, kind in _PLAIN.items()},
    )


def _goals_from_dict(stored: Mapping[str, Any]) -> StoredGoals:
    return StoredGoals(
        host=_typed(stored["host"], str),
        instance=_typed(stored["instance"], str),
        goals=tuple(
            OpenGoal(path=_typed(path, str), action=action, goal_id=bytes.fromhex(goal_id))
            for path, action, goal_id in stored["goals"]
        ),
    )


def _run_end_from_dict(stored: Mapping[str, Any], space: SceneSpace) -> EarlierRun:
    return EarlierRun(
        epoch=_typed(stored["epoch"], str),
        goal=_required(RunGoal, stored["goal"]),
        scene=_scene_from_dict(stored["scene"], space),
        outcome=RunOutcome(stored["outcome"]),
        message=_typed(stored["message"], str),
        stop_cause=_typed(stored["stop_cause"], int),
        stopped_by=StoppedBy(stored["stopped_by"]),
        stop_reason=_typed(stored["stop_reason"], str),
        orphans=tuple(_typed(one, str) for one in stored["orphans"]),
        ticks=_typed(stored["ticks"], int),
        overruns=_typed(stored["overruns"], int),
        duration_s=_typed(stored["duration_s"], float),
    )


def _checked(kind: type[_Stored], stored: Any) -> _Stored | None:
    return None if stored is None else _required(kind, stored)


def _required(kind: type[_Stored], stored: Any) -> _Stored:
    fields = {
        name: _typed(stored[name], int if name in _INTEGERS else str)
        for name in kind.__dataclass_fields__
        if name in stored
    }
    return kind(**fields)


def _typed(value: Any, kind: type) -> Any:
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise TypeError(f"{str(value)[:40]!r} is not of type {kind.__name__}")
    return value
