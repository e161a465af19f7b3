# SPDX-License-Identifier: Apache-2.0
"""Names of scenes for people, in place of their ids."""

from __future__ import annotations

import re
from typing import Any

from bt_agents_core.scene import first_id, scene_name, unawarded_id
from bt_agents_core.text import ellipsize

_LONGEST_LABEL = 200
_MOST_LABELS = 1_000


class SceneLabels:
    """Names of the last scenes for people: the label, else the values, instead of the id."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def add(self, scene: Any) -> None:
        """Store the name of a scene, as ``Scene.msg`` has it."""
        if len(scene.scene_id) > _LONGEST_LABEL:
            return  # the market takes none with such an id
        name = ellipsize(scene_name(scene), _LONGEST_LABEL)
        self._names[scene.scene_id] = name
        self._names.setdefault(first_id(scene.scene_id), name)
        while len(self._names) > _MOST_LABELS:
            del self._names[next(iter(self._names))]

    def name_of(self, scene_id: str) -> str:
        """Return the name of a scene; else of the one as announced; its id when none is known.

        A follow-up round is for a scene of its own, which may have another name.
        """
        announced = first_id(scene_id)
        ids = (scene_id, announced, unawarded_id(announced))
        return next(filter(None, map(self._names.get, ids)), scene_id)

    def with_names(self, text: str) -> str:
        """Return a text for people with names in place of quoted ids."""
        return re.sub(r"'([^']*)'", lambda match: f"'{self.name_of(match[1])}'", text)
