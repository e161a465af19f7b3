# SPDX-License-Identifier: Apache-2.0
"""What people call a scene: by its label, else by its values, instead of its id."""

from __future__ import annotations

import math
import re
from typing import Any

from bt_agents_core.scene import AGAIN

_QUOTED = re.compile(r"'([^']*)'")


class SceneLabels:
    """Knows the names of the scenes that it was shown."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def take(self, scene: Any) -> None:
        """Learn the name of a scene, as ``Scene.msg`` has it."""
        known = (v for v in scene.values if not math.isnan(v.value))
        values = ", ".join(f"{v.name} {v.value:g}" for v in known)
        self._names[_first(scene.scene_id)] = scene.label or values or "nothing known"

    def of(self, scene_id: str) -> str:
        """Return the name of a scene; its id when it was never shown."""
        return self._names.get(_first(scene_id), scene_id)

    def in_words(self, text: str) -> str:
        """Return words for people with names in place of quoted ids."""
        return _QUOTED.sub(lambda match: f"'{self.of(match[1])}'", text)


def _first(scene_id: str) -> str:
    """Return the id that a scene had before a market was restarted and asked again for it."""
    return scene_id.removesuffix(AGAIN)
