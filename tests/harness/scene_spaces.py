# SPDX-License-Identifier: Apache-2.0
"""The scene parameters of most tests: an age and a mood from 1 to 5."""

from __future__ import annotations

from bt_agents_core.scene import SceneParameter, SceneSpace

AGE_AND_MOOD = SceneSpace(
    parameters=tuple(
        SceneParameter(name=name, minimum=1.0, maximum=5.0, default=3.0)
        for name in ("age", "mood")
    ),
    mood="mood",
)
