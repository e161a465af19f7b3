# SPDX-License-Identifier: Apache-2.0
"""Templates of an author's first files, and patterns: free of errors, ready to be changed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.model.scene_specs import SceneSpec
from bt_agents_language.model.specs import SkillSpec

_TEST = ".test.yaml"
_FOLDER = Path(str(files("bt_agents_language"))) / "tools" / "templates" / "patterns"


class _Template(Template):
    """Text with names such as ``@{name}``, because ``$`` and braces have a meaning in trees."""

    delimiter = "@"


def _filled(template: str, **names: str) -> str:
    folder = files("bt_agents_language").joinpath("tools/templates")
    text = folder.joinpath(f"{template}.yaml").read_text(encoding="utf-8")
    return _Template(text).substitute(names)


def new_agent(
    name: str, folder: str, file: str, scene: SceneSpec, skills: Mapping[str, SkillSpec]
) -> str:
    """Return the text of an agent file whose profile fits the parameters of the scene.

    The agent speaks if there is a usable skill ``say``, otherwise it only logs; the folder and the
    file have the names that the author would use.
    """
    return _filled(
        "agent",
        **_remarks(scene.space, skills),
        name=name,
        folder=folder,
        file=file,
        title=_title(name),
        profile=_profile(scene.space),
        requires="requires: scene.person\n" if scene.person is not None else "",
        feedback=_feedback(scene.space),
    )


def new_test(name: str, file: str, scene: SceneSpec, skills: Mapping[str, SkillSpec]) -> str:
    """Return the text of a test for the agent that :func:`new_agent` makes."""
    parameter = scene.space.parameters[0]
    # The default is large enough, unless it is the smallest value.
    high = {} if _middle(parameter) == parameter.default else {parameter.name: parameter.maximum}
    high_scene = _scene(scene.space, high)
    mood = _mood(scene.space)
    stopped = _filled("test_cancelled", scene=high_scene)
    if mood is not None:
        stopped = _filled(
            "test_stopped", scene=high_scene, mood=mood.name, worst=_number(mood.minimum)
        )
    remarks = _remarks(scene.space, skills)
    # Without a voice, a test has no line about speech.
    says = "      says: [Hello., {}, Good-bye.]\n" if remarks["say"] == "say" else ""
    return _filled(
        "test",
        **remarks,
        name=name,
        file=file,
        high_scene=high_scene,
        low_scene=_scene(scene.space, {parameter.name: parameter.minimum}),
        says_high=says.format(remarks["high"]),
        says_low=says.format(remarks["low"]),
        stopped=stopped,
    )


def new_library(name: str, skills: Mapping[str, SkillSpec]) -> str:
    """Return the text of a library; ``skills`` are as in :func:`new_agent`."""
    return _filled("library", name=name, say=_say(skills))


def new_first_test(name: str, file: str, scene: Mapping[str, float], ends: str) -> str:
    """Return the text of a first test for an existing agent, with its ending in a scene."""
    return _filled("first_test", name=name, file=file, scene=_flow(scene), ends=ends)


def new_script(name: str, file: str, space: SceneSpace) -> str:
    """Return the text of a script with two visits."""
    return _filled("script", title=_title(name), file=file, scene=_scene(space, {}))


def new_skill(name: str) -> str:
    """Return the text of a skills file with one skill."""
    return _filled("skill", name=name)


def new_experiment(name: str, folder: str) -> Mapping[str, str]:
    """Return the texts of an experiment with two agents by their files in its folder."""
    agents = {
        f"agents/{agent}.yaml": _filled("experiment_agent", name=agent, title=_title(agent))
        for agent in ("calm", "lively")
    }
    return {
        "scene.yaml": _filled("experiment_scene"),
        **agents,
        "experiment.yaml": _filled("experiment", title=_title(name), folder=folder),
    }


def new_sweep(name: str, file: str) -> str:
    """Return the text of a sweep over the experiment of the same name."""
    return _filled("sweep", name=name, title=_title(name), file=file)


def _remarks(space: SceneSpace, skills: Mapping[str, SkillSpec]) -> dict[str, str]:
    """Return the remarks of an agent and its test, and the parameter that they are about."""
    parameter = space.parameters[0]
    middle = _number(_middle(parameter))
    return {
        "say": _say(skills),
        "parameter": parameter.name,
        "middle": middle,
        "high": f"Here {parameter.name} is {middle} or more.",
        "low": f"Here {parameter.name} is less than {middle}.",
    }


def _say(skills: Mapping[str, SkillSpec]) -> str:
    """Return the node for a text: the skill ``say`` if it has the usual form, else ``log``."""
    skill = skills.get("say")
    if skill is None:
        return "log"
    enough = set(skill.required) <= {skill.main}
    return "say" if skill.main_is_text and enough else "log"


def _scene(space: SceneSpace, values: Mapping[str, float]) -> str:
    """Return a scene of defaults with some other values."""
    return _flow({one.name: values.get(one.name, one.default) for one in space.parameters})


def _flow(values: Mapping[str, float]) -> str:
    return f"{{{', '.join(f'{name}: {_number(value)}' for name, value in values.items())}}}"


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _profile(space: SceneSpace) -> str:
    parameters = space.profiles.parameters
    values = [f"  {one.name}: {_number(one.default)}" for one in parameters]
    width = max(map(len, values)) + 2
    return "\n".join(
        f"{value:<{width}}# {_range(one)}" for value, one in zip(values, parameters, strict=True)
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
    return _filled(
        "agent_feedback", mood=mood.name, little=_number(size / 8), much=_number(size / 4)
    )


def _mood(space: SceneSpace) -> SceneParameter | None:
    return next((one for one in space.parameters if one.name == space.mood), None)


def _middle(parameter: SceneParameter) -> float:
    """Return a value that a scene can be below: the default, unless it is the smallest."""
    if parameter.default > parameter.minimum:
        return parameter.default
    return (parameter.minimum + parameter.maximum) / 2


def _number(value: float) -> str:
    """Return a number without an exponent, exact enough to stay in its range."""
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def pattern_names() -> tuple[str, ...]:
    """Return the names of all patterns."""
    return tuple(sorted(file.name.removesuffix(_TEST) for file in _FOLDER.glob(f"*{_TEST}")))


def pattern_file(name: str) -> Path:
    """Return the agent file of a pattern; its test is next to it.

    Raises:
        BtAgentsError: There is no such pattern.
    """
    known = pattern_names()
    if name not in known:
        hint = did_you_mean(name, known) or f"there are {', '.join(known)}"
        raise BtAgentsError(f"there is no pattern '{name[:100]}'; {hint}")
    return _FOLDER / f"{name}.yaml"


def tests_beside(agent: Path) -> Path:
    """Return the path of the tests next to an agent file."""
    return agent.with_name(f"{agent.stem}{_TEST}")


def renamed(text: str, before: str, after: str) -> str:
    """Return the text of an agent file or of its tests for an agent of another name."""
    text = re.sub(
        rf"^((?:agent|test): *){before}\b(?!\.)", rf"\g<1>{after}", text, flags=re.MULTILINE
    )
    # Comments and tests also name the file.
    return re.sub(rf"\bagents/{before}(?=\.(?:test\.)?yaml\b)", f"agents/{after}", text)
