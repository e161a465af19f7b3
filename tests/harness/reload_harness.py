# SPDX-License-Identifier: Apache-2.0
"""A trees folder that a test edits as people and editors do, and the watch that reads it."""

from __future__ import annotations

from pathlib import Path

from bt_agents.host.reload.folder_watch import FolderWatch
from bt_agents.host.reload.versions import AgentVersions, ReloadEffect
from bt_agents_language.files.folder_reader import Trees, read_trees

SCENE = "format: 1\nparameters:\n  age: {min: 1, max: 5, default: 3}\n"
SKILLS = (
    "format: 1\nskills:\n"
    "  say:\n    main: text\n    inputs: {text: text}\n"
    "    topic: {name: say, type: std_msgs/msg/String, message: {data: '${text}'}}\n"
)
MANNERS = "format: 1\nsubtrees:\n  greet: {tree: {say: Good day.}}\n"


def agent(name: str, tree: str = "{say: hello}", head: str = "") -> str:
    """Return the text of an agent file."""
    return f"format: 1\nagent: {name}\nprofile: {{age: 3}}\n{head}tree: {tree}\n"


def new_folder(path: Path, *names: str) -> Path:
    """Make a trees folder with some agents."""
    for part in ("skills", "agents", "libraries"):
        (path / part).mkdir(parents=True)
    (path / "scene.yaml").write_text(SCENE)
    (path / "skills" / "robot.yaml").write_text(SKILLS)
    (path / "libraries" / "manners.yaml").write_text(MANNERS)
    for name in names:
        write(path, name, agent(name))
    return path


def write(folder: Path, name: str, text: str) -> Path:
    """Write an agent file."""
    file = folder / "agents" / f"{name}.yaml"
    file.write_text(text)
    return file


class Watched:
    """A folder, its watch, and the versions of its agents."""

    def __init__(self, folder: Path, tags: str = "") -> None:
        self.folder = folder
        self.running = ""
        trees = read_trees(folder).tagged(tags)
        self.watch = FolderWatch(trees)
        self.versions = AgentVersions(trees)
        self.in_force = {agent.name: agent for agent in trees.agents}

    def poll(self) -> list[str]:
        """Poll until the folder is unchanged; return the reports."""
        said: list[str] = []
        for _ in range(3):
            said += self.poll_once()
        return said

    def poll_once(self) -> list[str]:
        """Poll once; return the reports."""
        trees = self.watch.poll()
        return self.settle(trees) if trees is not None else []

    def settle(self, trees: Trees) -> list[str]:
        """Settle all changed agents."""
        effects = [
            self.versions.settle(name, self.running) for name in self.versions.update(trees)
        ]
        return [self.apply(effect) for effect in effects if effect is not None]

    def end_run(self) -> list[str]:
        """End the run; return the reports."""
        name, self.running = self.running, ""
        effect = self.versions.run_ended(name)
        return [self.apply(effect)] if effect is not None else []

    def apply(self, effect: ReloadEffect) -> str:
        """Execute an effect as a host does; return its text."""
        action = effect.action.value
        if action == "remove":
            del self.in_force[effect.name]
        elif action != "report":
            assert (action == "add") == (effect.name not in self.in_force)
            self.in_force[effect.name] = effect.agent
        return f"{action} {effect.text}"
