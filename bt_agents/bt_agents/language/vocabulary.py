# SPDX-License-Identifier: Apache-2.0
"""What an agent file may speak of: the scene parameters, the skills and the ROS types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents.language.interfaces import Interfaces
from bt_agents.language.specs import SkillSpec
from bt_agents.scene import SceneSpace


@dataclass(frozen=True)
class Vocabulary:
    """The words that agent files are checked against.

    Attributes:
        space: The scene parameters.
        skills: Skills by name.
        interfaces: The installed ROS types; None leaves types and fields unchecked.
    """

    space: SceneSpace
    skills: Mapping[str, SkillSpec]
    interfaces: Interfaces | None = None
