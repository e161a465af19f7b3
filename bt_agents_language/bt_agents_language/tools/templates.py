# SPDX-License-Identifier: Apache-2.0
"""First versions of an author's files: commented, without errors, and ready to be changed."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import FieldType, SkillSpec

_AGENT = """\
# What {name} is and does. Lines that start with '#' are for people only.
# Whether it works:  bt-agents check {folder}
# What it does:      bt-agents rehearse {file}
format: 1
agent: {name}
title: {title}
description: >
  Write here in a sentence or two what it does, and whom it suits.
tags: []

# Its bid: the scene that suits it best. Feedback moves it from here.
profile:
{profile}

# How far one feedback moves it: 0 not at all, 1 all the way.
learning_rate: 0.2
{requires}
# Values to tune while it runs; ${{patience}} stands for the value of the first.
tunables:
  patience: {{default: 2 s, min: 0 s, max: 30 s, description: how long it waits}}
{feedback}
# What it does. A node is one word and its value, and what changes it beside it.
tree:
  sequence:  # one after the other, until one fails
    - {say}: Hello.
    - name: remark  # a name for people, in logs and pictures
      selector:     # tries one after the other, until one succeeds
        - sequence:
            - check: scene.{parameter} >= {middle}
            - {say}: {high}
        - {say}: {low}
    - wait: ${{patience}}
    - {say}: Good-bye.

# What it still does when it is stopped.
on_cancel: {{{say}: All right.}}
"""
_FEEDBACK = """
# What a change of {mood} while it runs teaches it.
feedback:
  - when: mood.change >= {little}
    for: 2 s
    give: positive
  - when: mood.change <= -{much}
    for: 2 s
    give: negative
    then: cancel  # and let the market ask again
"""
_TEST = """\
# bt-agents test {file}
format: 1
test: {name}

cases:
  - name: it greets, makes its remark and says good-bye
    scene: {high_scene}
    expect:
{says_high}      visited: tree/1.remark/0.sequence
      ends: succeeded
      within: 1 min

  - name: it makes the other remark where {parameter} is less than {middle}
    scene: {low_scene}
    expect:
{says_low}      visited: tree/1.remark/1.{say}
      ends: succeeded
{stopped}"""
_STOPPED = """
  - name: it stops when the mood falls
    scene: {scene}
    during:
      - {{after: 0 s, {mood}: {worst}}}
    tunables: {{patience: 30 s}}
    expect:
      feedback: negative
      ends: cancelled
"""
_CANCELLED = """
  - name: it stops when somebody cancels it
    scene: {scene}
    during:
      - {{after: 1 s, cancel: the operator}}
    expect:
      ends: cancelled
"""
_LIBRARY = """\
# Subtrees that several agents share. An agent takes them in with
#   imports: [libraries/{name}.yaml]
# and uses one with
#   - subtree: remind
#     with: {{words: Please take your bag.}}
format: 1
description: Write here what these subtrees are for.

subtrees:
  remind:
    description: Says something, and says it again after a while.
    inputs:
      words: {{type: text, description: what to say}}
      pause: {{type: duration, default: 5 s, description: how long to wait in between}}
    tree:
      sequence:
        - {say}: ${{words}}
        - wait: ${{pause}}
        - {say}: ${{words}}
"""


def new_agent(
    name: str, folder: str, file: str, scene: SceneSpec, skills: Mapping[str, SkillSpec]
) -> str:
    """Return the text of an agent file.

    Args:
        name: Of the agent.
        folder: The trees folder, as the author would name it.
        file: The agent file, likewise.
        scene: Its profile fits the parameters of this.
        skills: It says something when they have a usable ``say``, else it only writes a log.
    """
    parameter = scene.space.parameters[0]
    middle = _number(_middle(parameter))
    return _AGENT.format(
        name=name,
        folder=folder,
        file=file,
        title=name.replace("_", " ").capitalize(),
        profile=_profile(scene.space),
        requires="requires: scene.person\n" if scene.person is not None else "",
        feedback=_feedback(scene.space),
        say=_say(skills),
        parameter=parameter.name,
        middle=middle,
        high=_high(parameter),
        low=_low(parameter),
    )


def new_test(name: str, file: str, scene: SceneSpec, skills: Mapping[str, SkillSpec]) -> str:
    """Return the text of a test for the agent that :func:`new_agent` makes.

    Args:
        name: Of the agent.
        file: The test file, as the author would name it.
        scene: As for the agent.
        skills: As for the agent.
    """
    parameter = scene.space.parameters[0]
    say = _say(skills)
    # The default is high enough, unless it is the smallest value.
    high = {} if _middle(parameter) == parameter.default else {parameter.name: parameter.maximum}
    high_scene = _scene(scene.space, high)
    mood = _mood(scene.space)
    stopped = _CANCELLED.format(scene=high_scene)
    if mood is not None:
        stopped = _STOPPED.format(scene=high_scene, mood=mood.name, worst=_number(mood.minimum))
    return _TEST.format(
        name=name,
        file=file,
        parameter=parameter.name,
        middle=_number(_middle(parameter)),
        high_scene=high_scene,
        low_scene=_scene(scene.space, {parameter.name: parameter.minimum}),
        says_high=_says(say, _high(parameter)),
        says_low=_says(say, _low(parameter)),
        say=say,
        stopped=stopped,
    )


def new_library(name: str, skills: Mapping[str, SkillSpec]) -> str:
    """Return the text of a library; ``skills`` are as in :func:`new_agent`."""
    return _LIBRARY.format(name=name, say=_say(skills))


def _say(skills: Mapping[str, SkillSpec]) -> str:
    """Return the node that takes a text: the skill ``say`` if it is usual, else ``log``."""
    skill = skills.get("say")
    if skill is None:
        return "log"
    needed = [one.name for one in skill.inputs if one.required]
    is_text = any(one.name == skill.main and one.type is FieldType.TEXT for one in skill.inputs)
    return "say" if is_text and needed in ([], [skill.main]) else "log"


def _says(say: str, remark: str) -> str:
    """Return the line of a test about all that is said; nothing where there is no voice."""
    return f"      says: [Hello., {remark}, Good-bye.]\n" if say == "say" else ""


def _scene(space: SceneSpace, values: Mapping[str, float]) -> str:
    """Return a scene of defaults, apart from some values."""
    every = {one.name: values.get(one.name, one.default) for one in space.parameters}
    return f"{{{', '.join(f'{name}: {_number(value)}' for name, value in every.items())}}}"


def _profile(space: SceneSpace) -> str:
    values = [f"  {one.name}: {_number(one.default)}" for one in space.parameters]
    width = max(map(len, values)) + 2
    return "\n".join(
        f"{value:<{width}}# {_range(one)}"
        for value, one in zip(values, space.parameters, strict=True)
    )


def _range(parameter: SceneParameter) -> str:
    limits = f"{_number(parameter.minimum)} to {_number(parameter.maximum)}"
    words = " ".join(parameter.description.split())
    return f"{limits}: {words}" if words else limits


def _feedback(space: SceneSpace) -> str:
    mood = _mood(space)
    if mood is None:
        return ""
    size = mood.maximum - mood.minimum
    return _FEEDBACK.format(mood=mood.name, little=_number(size / 8), much=_number(size / 4))


def _mood(space: SceneSpace) -> SceneParameter | None:
    return next((one for one in space.parameters if one.name == space.mood), None)


def _middle(parameter: SceneParameter) -> float:
    """Return a value that a scene can be below of: the default, if it is not the smallest."""
    if parameter.default > parameter.minimum:
        return parameter.default
    return (parameter.minimum + parameter.maximum) / 2


def _high(parameter: SceneParameter) -> str:
    return f"Here {parameter.name} is {_number(_middle(parameter))} or more."


def _low(parameter: SceneParameter) -> str:
    return f"Here {parameter.name} is less than {_number(_middle(parameter))}."


def _number(value: float) -> str:
    """Return a number without an exponent, exact enough to stay in its range."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
