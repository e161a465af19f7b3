# SPDX-License-Identifier: Apache-2.0
"""Run control from the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from programs import Ask, Start

pytestmark = pytest.mark.e2e

AGENT = """
format: 1
agent: greeter
title: Greeter
description: Says two sentences.
profile: {age: 3, familiarity: 3, mood: 3}
tunables:
  words: {default: Good morning, description: what it says}
tree:
  sequence:
    - say: "${words}"
    - wait: 1 s
    - say: {text: Bye}
"""


def until(ask: Ask, words: str, *command: str) -> str:
    """Repeat a command until its output contains these words; return the output."""
    shown = ""
    for _ in range(30):
        shown = ask(*command)
        if words in shown:
            break
    assert words in shown
    return shown


def test_run_stops_at_breakpoint_steps_and_resumes(start_up: Start, ask: Ask, trees: Path) -> None:
    for path in (trees / "agents").iterdir():
        path.unlink()
    (trees / "agents" / "greeter.yaml").write_text(AGENT)
    up = start_up(str(trees))
    assert "no agent is running" in ask("pause", code=1)
    assert "no breakpoints" in ask("breakpoint")
    assert "did you mean '1.wait'" in ask("breakpoint", "greeter", "1.wiat", code=1)
    assert "greeter pauses before tree/0.say, tree/1.wait" in ask(
        *("breakpoint", "greeter", "0.say", "tree/1.wait")
    )
    assert ask("breakpoint", "greeter", "--csv").splitlines()[-4:] == [
        "greeter,tree,sequence,False",
        'greeter,tree/0.say,"say ""${words}""",True',
        "greeter,tree/1.wait,wait 1 s,True",
        'greeter,tree/2.say,"say ""Bye""",False',
    ]
    ask("trigger", "age=3")
    up.until("greeter wins")
    assert "paused before tree/0.say, until 'bt-agents resume'" in until(ask, "paused", "status")
    assert "greeter was ticked once, and is at tree/0.say" in ask("step")
    up.until("says: Good morning")
    until(ask, 'at say "Good morning" (tree/0.say)', "status")
    assert "greeter pauses before tree/1.wait" in ask("breakpoint", "greeter", "--remove", "0.say")
    assert "greeter goes on" in ask("resume", "--author", "anna")
    until(ask, '"paused_at": "tree/1.wait"', "status", "--json")
    assert "greeter has no breakpoints" in ask("breakpoint", "greeter", "--remove")
    assert "greeter goes on" in ask("resume")
    up.until("says: Bye")
    up.until("greeter succeeded")
    assert "no agent is running" in ask("step", code=1)
