# SPDX-License-Identifier: Apache-2.0
"""Laws of reloading: the version in force is valid and complete, and follows the files."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_language.model.specs import AgentSpec, iter_nodes
from memory_folder import memory_folder
from reload_harness import Watched, new_folder

NAMES = ("ann", "bob")
FILES = ("one", "two")


def text_of(name: str, mark: int) -> str:
    return (
        f"format: 1\nagent: {name}\nimports: [libraries/manners.yaml]\n"
        f"profile: {{age: {1 + mark % 4}}}\n"
        f"tree: {{sequence: [{{say: m{mark}}}, {{subtree: greet}}, {{say: m{mark}}}]}}\n"
    )


def library_of(mark: int) -> str:
    say = f"{{say: l{mark}}}"
    return f"format: 1\nsubtrees:\n  greet: {{tree: {{sequence: [{say}, {say}]}}}}\n"


def marks(spec: AgentSpec) -> tuple[int, int]:
    """Return what the tree reports about its file and its library, which must match."""
    words = [str(node.fields["text"].value) for node in iter_nodes(spec.tree) if node.skill]
    own, theirs = {w for w in words if w[0] == "m"}, {w for w in words if w[0] == "l"}
    assert (len(words), len(own), len(theirs)) == (4, 1, 1), f"a mix: {words}"
    mark = int(own.pop()[1:])
    assert spec.profile == (1 + mark % 4,)
    return mark, int(theirs.pop()[1:])


files = st.sampled_from(FILES)
names = st.sampled_from(NAMES)
events = st.one_of(
    st.tuples(st.just("write"), files, names),
    st.tuples(st.just("half"), files, names),
    st.tuples(st.just("delete"), files),
    st.tuples(st.just("replace"), files, names),
    st.tuples(st.just("library")),
    st.tuples(st.just("broken library")),
    st.tuples(st.just("vanish")),
    st.tuples(st.just("run"), names),
    st.tuples(st.just("end")),
    st.tuples(st.just("look")),
    st.tuples(st.just("settle")),
    st.tuples(st.just("edit"), files, names),
)


class World:
    """A folder under random changes, and all valid versions of its files."""

    def __init__(self, folder: Path) -> None:
        self.folder = new_folder(folder)
        self.library = folder / "libraries" / "manners.yaml"
        self.library.write_text(library_of(0))
        self.count = 0
        self.good: dict[str, set[int]] = {name: set() for name in NAMES}
        self.libraries = {0}
        self.write("one", "ann")
        self.watched = Watched(folder)
        self.held: AgentSpec | None = None

    def write(self, file: str, name: str) -> None:
        self.count += 1
        self.good[name].add(self.count)
        (self.folder / "agents" / f"{file}.yaml").write_text(text_of(name, self.count))

    def happen(self, event: tuple) -> None:
        watched, agents = self.watched, self.folder / "agents"
        match event:
            case ("write", file, name):
                self.write(file, name)
            case ("half", file, name):
                self.count += 1
                text = text_of(name, self.count)
                (agents / f"{file}.yaml").write_text(text[: len(text) // 2])
            case ("delete", file):
                (agents / f"{file}.yaml").unlink(missing_ok=True)
            case ("replace", file, name):
                self.write(f".{file}", name)
                (agents / f".{file}.yaml").rename(agents / f"{file}.yaml")
            case ("library",):
                self.count += 1
                self.libraries.add(self.count)
                self.library.write_text(library_of(self.count))
            case ("broken library",):
                self.library.write_text("format: 1\nsubtrees: [\n")
            case ("vanish",):
                agents.rename(self.folder / ".away")
                watched.poll_once()
                (self.folder / ".away").rename(agents)
            case ("run", name):
                if not watched.running and name in watched.in_force:
                    watched.running = name
                    self.held = watched.in_force[name]
            case ("end",):
                watched.end_run()
            case ("look",):
                watched.poll_once()
            case ("settle",):
                watched.poll()
            case ("edit", file, name):
                self.write(file, name)
                watched.poll()

    def check(self) -> None:
        for name, spec in self.watched.in_force.items():
            assert spec.name == name
            mark, library = marks(spec)
            assert mark in self.good[name]
            assert library in self.libraries
        running = self.watched.running
        if running:
            assert self.held is not None
            assert marks(self.watched.in_force[running]) == marks(self.held)


@settings(max_examples=150, deadline=None)
@given(st.lists(events, max_size=30))
def test_active_version_is_valid_and_never_mixed(happening):
    with memory_folder() as folder:
        world = World(folder)
        world.check()
        for event in happening:
            world.happen(event)
            world.check()


@settings(max_examples=80, deadline=None)
@given(st.lists(events, max_size=25))
def test_agents_converge_to_file_contents(happening):
    with memory_folder() as folder:
        world = World(folder)
        for event in happening:
            world.happen(event)
        world.watched.end_run()
        for path in (world.folder / "agents").iterdir():
            path.unlink()
        world.write("one", "bob")
        world.happen(("library",))
        world.watched.poll()
        assert {name: marks(one) for name, one in world.watched.in_force.items()} == {
            "bob": (world.count - 1, world.count)
        }
        assert not world.watched.versions.trees.broken
