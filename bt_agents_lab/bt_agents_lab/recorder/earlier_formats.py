# SPDX-License-Identifier: Apache-2.0
"""Recordings of earlier versions, as this one would have made them."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from bt_agents_ros.system_topics import PREFIX, TOPICS

_MOST_TOPICS = 1000

_PREFIXED = tuple(topic for topic in TOPICS if topic.name.startswith(PREFIX))


@lru_cache(_MOST_TOPICS)
def present_name(topic: str, type_name: str) -> str:
    """Return the name that a recorded topic has now.

    Earlier ones stand without :data:`PREFIX`: ``/robot1/runs`` is ``/robot1/bt_agents/runs``. A
    topic of another type keeps its name.
    """
    known = [one.name for one in _PREFIXED if one.type == type_name]
    if any(topic.endswith(f"/{name}") for name in known):
        return topic
    for name in known:
        before = name.removeprefix(PREFIX)
        if topic.endswith(f"/{before}"):
            return topic.removesuffix(before) + name
    return topic


def present_fields(message: Any) -> Any:
    """Return a decoded message of the system, which is given the fields that it has now.

    Earlier ones, and the scenes in them, have a ``stamp`` in place of their header.
    """
    scenes = (getattr(message, "scene", None), *getattr(message, "scenes", ()))
    for one in (message, *scenes):
        if hasattr(one, "stamp") and not hasattr(one, "header"):
            one.header = SimpleNamespace(stamp=one.stamp, frame_id="")
    return message
