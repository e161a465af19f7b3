# SPDX-License-Identifier: Apache-2.0
"""Acts for a person: what is said, asked and shown, and when an answer is expected."""

from __future__ import annotations

from bt_agents_robot.acts import Act, ActKind, Ask, Drive, Say, Show


def _shown(act: Act) -> tuple[ActKind, str, str, tuple[str, ...], float]:
    return act.kind, act.text, act.clip, act.choices, act.rate


def test_each_act_describes_its_visible_effect() -> None:
    say = Say(" Hello ", 1.5, pace=1.0, voice=None)
    ask = Ask("Shall we go?", ["Yes", " "], 0.0, pace=1.0, voice=None)
    assert _shown(say) == (ActKind.SAY, "Hello", "", (), 1.5)
    assert _shown(ask) == (ActKind.ASK, "Shall we go?", "", ("Yes",), 1.0)
    assert _shown(Show("map", "Gate 4", 0.0, pace=1.0)) == (ActKind.SHOW, "Gate 4", "map", (), 1.0)
    assert _shown(Drive("gate", pace=1.0)) == (ActKind.DRIVE, "gate", "", (), 1.0)
