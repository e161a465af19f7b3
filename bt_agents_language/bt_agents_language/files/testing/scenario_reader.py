# SPDX-License-Identifier: Apache-2.0
"""Reader of scenarios: scene, tunables, answers of the world and events of a rehearsal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.local_time import NOON, WEEKDAYS, LocalTime
from bt_agents_core.person_facts import Fact, fact
from bt_agents_core.stop_cause import STOPPERS, Cancellation
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.inputs import read_constant
from bt_agents_language.fields.interfaces import read_ros_name
from bt_agents_language.fields.references import inserted_texts
from bt_agents_language.fields.scene_values import read_values
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.texts import NoText
from bt_agents_language.fields.values import is_plain, plain, read_value
from bt_agents_language.files.testing.path_patterns import (
    branches_of,
    is_path,
    matches,
    nodes_of,
    path_hint,
)
from bt_agents_language.files.testing.replacement_reader import AT_ONCE, ReplacementReader
from bt_agents_language.files.testing.scenarios import (
    AnswerRule,
    GoalEnd,
    RehearsedPerson,
    Replacement,
    Scenario,
    ScriptedAnswer,
    ScriptedEvent,
    VariantRule,
)
from bt_agents_language.files.tunable_reader import check_setting
from bt_agents_language.model.specs import AgentSpec, Literal, NodeSpec, SkillSpec
from bt_agents_language.nodes.catalogue import NODE_TYPES, type_of
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.field_tables import (
    ANY,
    BOOLEAN,
    DURATION,
    FIELDS,
    ROS_NAME,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    Items,
    Key,
    KeyTable,
    SceneValues,
    Several,
    WordChoice,
    integer,
)
from bt_agents_language.yaml.typed_reader import MappingReader, Shape, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar, several

MOST_VISITS = 1_000_000

_ENDS = tuple(end.value for end in (GoalEnd.REJECTED, GoalEnd.UNREACHABLE, GoalEnd.NEVER))
_SILENT = {"silent": True, "back": False}

_ANSWER = KeyTable(
    fields=(
        FieldDecl("gives", ANY, "Value of the first output."),
        FieldDecl("outputs", Entries(ANY, "outputs and values", keys=Key.ANY), "Output → value."),
        FieldDecl("fails", TEXT, "The skill fails for this reason."),
        FieldDecl("ends", WordChoice(_ENDS), "How else the skill ends."),
        FieldDecl("after", DURATION, "How long the skill takes."),
    )
)
_MESSAGE = KeyTable(
    what="'publish'",
    fields=(
        FieldDecl("topic", ROS_NAME, "Topic of the message.", required=True),
        FieldDecl("message", FIELDS, "Fields of the message."),
    ),
)
_CANCEL = KeyTable(
    what="'cancel'",
    fields=(
        FieldDecl("reason", TEXT, "Why: cancel.reason.", required=True),
        FieldDecl(
            "by", WordChoice(STOPPERS), "Who cancels the run: cancel.by.", default=STOPPERS[0]
        ),
    ),
)
_HAPPENING = KeyTable(
    what="what happens",
    scene=True,
    fields=(
        FieldDecl("after", DURATION, "Time since the start of the run, or of 'at'."),
        FieldDecl("at", TEXT, "Path of the node from whose start 'after' counts."),
        FieldDecl("person", BOOLEAN, "Whether the person is there from now on."),
        FieldDecl(
            "scene_layer",
            WordChoice(tuple(_SILENT)),
            "Silent: from now on, nothing new is known of the scene.",
        ),
        FieldDecl("publish", _MESSAGE, "A message arrives."),
        FieldDecl("tune", Entries(ANY, "names and values"), "Tunable → new value."),
        FieldDecl(
            "cancel",
            Either((TEXT, _CANCEL)),
            "Cancels the run: a reason, for a cancel by an operator, or a mapping that says more.",
        ),
    ),
)
_CLOCK = KeyTable(
    what="'clock'",
    fields=(
        FieldDecl("hour", integer(0, 23), "Hour of the day.", default=NOON.hour),
        FieldDecl("weekday", WordChoice(WEEKDAYS), "Day of the week.", default=NOON.weekday),
    ),
)
_PERSON = KeyTable(
    what="'person'",
    fields=(
        FieldDecl("name", TEXT, "Name of the person: person.name.", required=True),
        FieldDecl(
            "visits", integer(1, MOST_VISITS), "How often the person has been here.", default=1
        ),
        FieldDecl(
            "remembers",
            Entries(ANY, "names and values"),
            "What agents have remembered of the person: {favourite: tea}.",
        ),
    ),
)
SCENARIO = KeyTable(
    what="a rehearsal",
    fields=(
        FieldDecl(
            "scene",
            SceneValues(person="Whether a person is there."),
            "The scene as awarded; scene.yaml decides about missing values.",
        ),
        FieldDecl(
            "person",
            Either((BOOLEAN, _PERSON)),
            "Whether a person is there, or which person: {name: anna, visits: 3}.",
        ),
        FieldDecl("clock", _CLOCK, "The local time at the start, on the hour."),
        FieldDecl(
            "tunables", Entries(ANY, "names and values"), "Values that differ from the defaults."
        ),
        FieldDecl("seed", integer(0), "Makes all random choices the same each time."),
        FieldDecl(
            "picks",
            Several(TEXT),
            "Paths of the children that 'random' nodes choose, in this order; the last one again "
            "and again.",
        ),
        FieldDecl(
            "answers",
            Entries(
                Several(Either((TEXT, _ANSWER))), "skills or paths, and answers", keys=Key.ANY
            ),
            "Skill or path of a node → how the world answers.",
        ),
        FieldDecl(
            "variants",
            Entries(Several(integer(1)), "paths and numbers", keys=Key.ANY),
            "Path of a node with 'one_of' → number of the text that it takes, from 1; a list is "
            "taken in turn.",
        ),
        FieldDecl(
            "replace",
            Entries(Either((WordChoice(tuple(AT_ONCE)), FIELDS)), "paths and nodes", keys=Key.ANY),
            "Path of a node → its replacement.",
        ),
        FieldDecl("during", Items(_HAPPENING), "What happens during the run."),
    ),
)
"""Keys for the start of a rehearsal."""


class ScenarioReader:
    """Reader of scenarios for one agent, in the language of its texts.

    Attributes:
        agent: The agent.
        skills: The skills that the agent's trees use, by name.
        known_skills: These and all other skills.
    """

    def __init__(self, reading: TypedReader, agent: AgentSpec, symbols: SymbolTable) -> None:
        if agent.language:
            symbols = symbols.speaking(agent.language)
        self.agent = agent
        self._reading = reading
        self._texts = NameScope({}, texts=symbols.texts)
        self._space = symbols.space
        self._interfaces = symbols.interfaces
        self._nodes = tuple(nodes_of(agent))
        self._tunables = {tunable.name: tunable for tunable in agent.tunables}
        self.skills: dict[str, SkillSpec] = {}
        for node in self._nodes:
            if node.skill is not None:
                self.skills.setdefault(node.kind, node.skill)
        named = {name: one for name, one in self.skills.items() if name not in NODE_TYPES}
        self.known_skills = {**symbols.skills, **named}
        self._replacements = ReplacementReader(
            reading, symbols.with_skills(named), self._nodes, self._tunables.values()
        )

    def read(self, fields: MappingReader) -> Scenario:
        """Return the scenario in the keys of a case."""
        scene = fields.get("scene")
        values: dict[str, float] = {}
        person, known = self._person(fields.get("person"))
        if isinstance(scene, MappingNode):
            node = None if "person" in self._space.names else scene.get("person")
            inner = None if node is None else self._reading.boolean(node, "'person'")
            person = inner if inner is not None else person
            entries = tuple(entry for entry in scene.entries if entry.key.text != "person")
            rest = replace(scene, entries=entries)
            values = read_values(self._reading, rest, "'scene'", self._space)
        elif scene is not None:
            self._reading.wrong_type(
                scene, "'scene'", "a mapping such as {age: 4, mood: 3}", Shape.MAPPING
            )
        return Scenario(
            scene=values,
            person=True if person is None else person,
            known=known,
            clock=self._clock(fields.get("clock")),
            tunables=self._tuned(fields.entries("tunables")),
            seed=fields.integer("seed") or 0,
            picks=self._picks(fields.get("picks")),
            answers=readable(map(self._rule, fields.entries("answers"))),
            variants=readable(map(self._variant, fields.entries("variants"))),
            replace=readable(map(self._replacement, fields.entries("replace"))),
            during=readable(map(self._happening, fields.items("during"))),
        )

    def _picks(self, node: Node | None) -> tuple[str, ...]:
        if node is None:
            return ()
        branches = [path for one in self._nodes for path in branches_of(one)]
        hint = "" if branches else "the agent has no 'random'; remove it"
        problem = "no child of a 'random'"
        return readable(
            self._matching(item, "'picks'", branches, problem, hint) for item in several(node)
        )

    def _person(self, node: Node | None) -> tuple[bool | None, RehearsedPerson | None]:
        """Return whether a person is present, if written, and who."""
        if node is None:
            return None, None
        if not isinstance(node, MappingNode):
            return self._reading.boolean(node, "'person'"), None
        fields = self._reading.keys(node, _PERSON)
        if fields is None:
            return True, None
        visits = fields.integer("visits")
        return True, RehearsedPerson(
            name=fields.text("name") or "",
            visits=visits or 1,
            remembers=self.facts(fields.entries("remembers")),
        )

    def told(self, node: Node, what: str) -> dict[str, float]:
        """Return values of scene parameters; report and omit wrong ones."""
        return read_values(self._reading, node, what, self._space)

    def facts(self, entries: Iterable[MappingEntry]) -> dict[str, Fact]:
        """Return the remembered facts about a person; report and omit wrong ones."""
        remembers: dict[str, Fact] = {}
        for entry in entries:
            key = entry.key.text
            wanted = self._space.remembers.get(key)
            if wanted is None:
                problem = "scene.yaml has, under remembers, no"
                self.refuse_name(
                    entry.key, problem, key, self._space.remembers, "declare it there"
                )
                continue
            value = read_constant(self._reading, entry.value, wanted, f"'{key}'")
            if value is None:
                continue
            try:
                remembers[key] = fact(key, value, wanted)
            except Refused as refused:
                self._reading.error("wrong-value", entry.value, refused.reason)
        return remembers

    def _clock(self, node: Node | None) -> LocalTime:
        fields = None if node is None else self._reading.keys(node, _CLOCK)
        if fields is None:
            return NOON
        hour = fields.integer("hour")
        return LocalTime(
            hour=NOON.hour if hour is None else hour,
            weekday=fields.choice("weekday") or NOON.weekday,
        )

    def path(self, node: Node, what: str, *, skills: bool = False) -> str | None:
        """Return a path or pattern that matches a node, or with ``skills`` a skill; else None."""
        known = [one.path for one in self._nodes if one.skill is not None or not skills]
        problem = f"no node of the agent{' that uses a skill' if skills else ''}"
        return self._matching(node, what, known, problem)

    def _matching(
        self, node: Node, what: str, known: list[str], problem: str, hint: str = ""
    ) -> str | None:
        """Return a path or pattern that matches a known path; else report it and return None.

        The hint usually names a similar path.
        """
        text = self._reading.text(node, what)
        if text is None or any(matches(text, path) for path in known):
            return text
        message = f"{problem} has the path {quote(text)}"
        self._reading.error("unknown-path", node, message, hint or path_hint(text, known))
        return None

    def refuse_name(
        self, node: Node, problem: str, name: str, known: Iterable[str], hint: str = ""
    ) -> None:
        """Report an unknown name; the hint is for a name that is similar to none."""
        message = f"{problem} {quote(name)}"
        self._reading.error("unknown-name", node, message, did_you_mean(name, known) or hint)

    def plain(self, node: Node, field_type: FieldType, what: str) -> Plain:
        """Return a value without names, or report that it is wrong and return None.

        It may insert texts of the language if these contain no names either.
        """
        if isinstance(node, Scalar) and not self._inserts_plain(node, what):
            return None
        value = read_value(self._reading, node, field_type, self._texts, what)
        if value is None:
            return None
        if is_plain(value):
            return plain(value)
        self._reading.error(
            "bad-reference",
            node,
            f"{what}: a test has no names to put into '${{…}}'",
            "write the value itself",
        )
        return None

    def _inserts_plain(self, node: Scalar, what: str) -> bool:
        """Return whether the texts that a value inserts, if any, are plain."""
        for name in inserted_texts(node.text):
            try:
                scalars = self._texts.text(name).scalars
            except NoText:
                continue  # it is reported where it is read
            first = quote(scalars[0].text)
            hint = f"write what is said, such as {first}"
            if len(scalars) > 1:
                problem = "is one of several texts, and a test needs a certain one"
                hint += ", and under 'variants' which one comes"
            elif "${" in scalars[0].text:
                problem = "has ${…} in it, which only the agent can fill in"
            else:
                continue
            self._reading.error("bad-reference", node, f"{what}: '{name}' {problem}", hint)
            return False
        return True

    def _tuned(self, entries: Iterable[MappingEntry]) -> dict[str, Plain]:
        values: dict[str, Plain] = {}
        for entry in entries:
            name = entry.key.text
            tunable = self._tunables.get(name)
            if tunable is None:
                self.refuse_name(entry.key, "the agent has no tunable", name, self._tunables)
                continue
            what = f"'{tunable.name}'"
            value = self.plain(entry.value, tunable.type, what)
            if value is not None and check_setting(
                self._reading, entry.value, what, value, tunable
            ):
                values[tunable.name] = value
        return values

    def _rule(self, entry: MappingEntry) -> AnswerRule | None:
        key = entry.key.text
        users = [one for one in self._nodes if one.skill is not None]
        if is_path(key):
            if self.path(entry.key, "the path of an answer", skills=True) is None:
                return None
            outputs = _outputs(next(one for one in users if matches(key, one.path)))
        elif key in self.skills:
            outputs = _outputs(next(one for one in users if one.kind == key))
        else:
            self.refuse_name(entry.key, "the agent's tree uses no skill", key, self.skills)
            return None
        items = several(entry.value)
        if not items:
            self._reading.error("missing-value", entry.value, f"{quote(key)} has no answer")
        what = f"the answer of {quote(key)}"
        answers = readable(self._answer(item, outputs, what) for item in items)
        if not items or len(answers) < len(items):
            return None
        return AnswerRule(key=key, answers=answers)

    def _answer(self, node: Node, outputs: _Outputs, what: str) -> ScriptedAnswer | None:
        if not isinstance(node, MappingNode):
            given = self._given(node, outputs, what)
            return None if given is None else ScriptedAnswer(outputs=given)
        fields = self._reading.keys(node, _ANSWER, what)
        if fields is None:
            return None
        written = [key for key in _ANSWER.values if key in fields.nodes and key != "after"]
        if len(written) > 1:
            self._reading.error(
                "contradiction",
                fields.keys[written[1]],
                f"{what} has '{written[0]}' and '{written[1]}', which exclude each other",
                "keep one of them",
            )
            return None
        after_s = fields.duration("after")
        if "fails" in fields.nodes:
            return ScriptedAnswer(end=GoalEnd.FAILS, reason=fields.text("fails"), after_s=after_s)
        if "ends" in fields.nodes:
            word = fields.choice("ends")
            return ScriptedAnswer(end=GoalEnd(word), after_s=after_s) if word else None
        if (node := fields.nodes.get("gives", node)) is not fields.mapping:
            given = self._given(node, outputs, what)
        else:
            given = self._named(fields, outputs)
        return None if given is None else ScriptedAnswer(outputs=given, after_s=after_s)

    def _given(self, node: Node, outputs: _Outputs, what: str) -> dict[str, Plain] | None:
        if outputs.main is None:
            text = node.text if isinstance(node, Scalar) else "this"
            self._reading.error(
                "wrong-type",
                node,
                f"{what}: it gives nothing back that could be {quote(text)}",
                "write {after: 3 s}, {fails: why} or {ends: never}",
            )
            return None
        name, field_type = outputs.main
        value = self.plain(node, field_type, f"'{name}'")
        return None if value is None else {name: value}

    def _named(self, fields: MappingReader, outputs: _Outputs) -> dict[str, Plain] | None:
        values: dict[str, Plain] = {}
        for entry in fields.entries("outputs"):
            name = entry.key.text
            if name not in outputs.types:
                self.refuse_name(entry.key, "there is no output", name, outputs.types)
                return None
            values[name] = self.plain(entry.value, outputs.types[name], f"'{name}'")
        return values

    def _variant(self, entry: MappingEntry) -> VariantRule | None:
        choosing = {one.path: one.variants for one in self._nodes if one.variants}
        what = "the path of a node with variants"
        problem = "no node of the agent that has several texts"
        pattern = self._matching(entry.key, what, [*choosing], problem)
        if pattern is None:
            return None
        counts = [
            len(one.texts)
            for path, variants in choosing.items()
            if matches(pattern, path)
            for one in variants
        ]
        items = several(entry.value)
        if not items:
            self._reading.error("missing-value", entry.value, f"{quote(pattern)} has no number")
        what = f"the text of {quote(pattern)}"
        numbers = readable(self._reading.integer(item, what, 1, min(counts)) for item in items)
        if not items or len(numbers) < len(items):
            return None
        return VariantRule(pattern=pattern, numbers=tuple(one - 1 for one in numbers))

    def _replacement(self, entry: MappingEntry) -> Replacement | None:
        pattern = self.path(entry.key, "the path of what is replaced")
        node = self._replacements.read(entry.value, pattern or "")
        if pattern is None or node is None:
            return None
        return Replacement(pattern=pattern, node=node)

    def _happening(self, node: Node) -> ScriptedEvent | None:
        names = [name for name in self._space.names if name not in _HAPPENING.values]
        fields = self._reading.keys(node, _HAPPENING, more=names)
        if fields is None:
            return None
        if "after" not in fields.nodes and "at" not in fields.nodes:
            self._reading.error(
                "missing-key",
                node,
                "what happens needs a time or the path of a node",
                "add 'after: 2 s', or 'at: tree/0.say'",
            )
        if not fields.keys.keys() - {"after", "at"}:
            self._reading.error(
                "missing-key",
                node,
                "nothing happens here",
                f"add '{names[0] if names else 'person'}: …', 'publish', 'tune' or 'cancel'",
            )
        topic, message = self._message(fields.get("publish"))
        return ScriptedEvent(
            after_s=fields.duration("after") or 0.0,
            at=fields.read("at", self.path) or "",
            values=self._values(fields, names),
            person=fields.boolean("person"),
            silent=_SILENT.get(fields.choice("scene_layer") or ""),
            tunables=self._tuned(fields.entries("tune")),
            topic=topic,
            message=message,
            cancel=self._cancel(fields.get("cancel")),
        )

    def _cancel(self, node: Node | None) -> Cancellation | None:
        if not isinstance(node, MappingNode):
            reason = None if node is None else self._reading.text(node, "'cancel'")
            return None if reason is None else Cancellation(by=STOPPERS[0], reason=reason)
        fields = self._reading.keys(node, _CANCEL)
        if fields is None:
            return None
        by = fields.choice("by") or STOPPERS[0]
        return Cancellation(by=by, reason=fields.text("reason"))

    def _values(self, fields: MappingReader, names: Iterable[str]) -> dict[str, float]:
        entries = tuple(
            # A misspelled name is already reported; it is read as the intended one.
            MappingEntry(key=replace(fields.keys[name], text=name), value=fields.nodes[name])
            for name in names
            if name in fields.nodes
        )
        mapping = replace(fields.mapping, entries=entries)
        return read_values(self._reading, mapping, "what happens", self._space)

    def _message(self, node: Node | None) -> tuple[str, Mapping[str, Plain]]:
        if node is None:
            return "", {}
        fields = self._reading.keys(node, _MESSAGE)
        if fields is None or (topic_node := fields.get("topic")) is None:
            return "", {}
        topic = read_ros_name(self._reading, topic_node, "'topic'") or ""
        self._refuse_unused_topic(topic_node, topic)
        message: Plain = {}
        if isinstance(written := fields.get("message"), MappingNode):
            message = self.plain(written, FieldType.ANY, "'message'")
        elif written is not None:
            self._reading.wrong_type(
                written, "'message'", "a mapping such as {data: true}", Shape.MAPPING
            )
        if not isinstance(message, Mapping):
            return topic, {}
        self._refuse_misfit(written or topic_node, topic, message)
        return topic, message

    def _refuse_misfit(self, node: Node, topic: str, message: Mapping[str, Plain]) -> None:
        """Report a message that does not fit the type that the agent expects on a topic."""
        known = self._interfaces
        if known is None:
            return
        waited = (type_of(one).resources(one).topic for one in self._nodes)
        types = dict.fromkeys(one[1] for one in waited if one is not None and one[0] == topic)
        for name in types:
            if known.type_problem(BindingKind.TOPIC, name):
                continue
            problem = known.value_problem(BindingKind.TOPIC, name, "message", message)
            if problem:
                self._reading.error("wrong-value", node, f"{name}: {problem}")

    def _refuse_unused_topic(self, node: Node, topic: str) -> None:
        topics = [one.fields["topic"] for one in self._nodes if "topic" in one.fields]
        known = [str(value.value) for value in topics if isinstance(value, Literal)]
        if topic and topic not in known and len(known) == len(topics):
            problem = "no node of the agent waits for a message on"
            self.refuse_name(node, problem, topic, known, "remove it")


@dataclass(frozen=True, kw_only=True)
class _Outputs:
    """Outputs of a skill; ``main`` is the first output in the result, if any."""

    types: Mapping[str, FieldType]
    main: tuple[str, FieldType] | None


def _outputs(node: NodeSpec) -> _Outputs:
    assert node.skill is not None
    early = node.skill.binding.feedback if node.skill.binding is not None else {}
    types = {output.name: output.type for output in node.skill.outputs}
    types = types or dict.fromkeys((*node.outputs, *node.feedback), FieldType.ANY)
    last = {name: types[name] for name in types if name not in early}
    return _Outputs(types=types, main=next(iter(last.items()), None))
