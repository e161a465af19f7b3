# SPDX-License-Identifier: Apache-2.0
"""Reader of ``*.test.yaml``: cases that rehearse an agent, with their expectations."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from bt_agents_core.diagnostic import Position
from bt_agents_core.errors import ReadError
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.testing.scenario_reader import SCENARIO, ScenarioReader
from bt_agents_language.files.testing.scenarios import (
    SPOKEN,
    AgentTest,
    AgentTestCase,
    Because,
    CancelledBy,
    Does,
    DoesNot,
    Ends,
    Expectation,
    ExpectedBids,
    Remembers,
    Says,
    Scenario,
    SkillUse,
    Teaches,
    Tells,
    Visits,
    Within,
)
from bt_agents_language.model.mood_rule import MoodAction
from bt_agents_language.model.specs import AgentSpec, SkillSpec
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.field_tables import (
    ANY,
    BOOLEAN,
    DURATION,
    NAME,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    Key,
    KeyTable,
    SceneValues,
    Several,
    Value,
    WordChoice,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, Shape, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, several

_FILE = re.compile(r"[\w-]{1,100}(\.ya?ml)?")
_KINDS = {kind.name.lower(): kind for kind in FeedbackKind}
_USE = Either((TEXT, Entries(ANY, keys=Key.ANY, single=True)))


def _contained(one: Value) -> KeyTable:
    """Return the keys of a mapping with some of the expected items, in order."""
    contains = FieldDecl(
        "contains",
        Several(one),
        "These items in order; other items may come between them.",
        required=True,
    )
    return KeyTable(fields=(contains,))


_EXPECT = KeyTable(
    what="'expect'",
    filled=True,
    fields=(
        FieldDecl("bids", BOOLEAN, "Whether the agent bids for the scene."),
        FieldDecl(
            "says", Several(TEXT, _contained(TEXT)), "Exactly what the agent says, in order."
        ),
        FieldDecl(
            "does",
            Several(_USE, _contained(_USE)),
            "Exactly the skills that the agent uses, in order.",
        ),
        FieldDecl("does_not", Several(_USE), "Skills that the agent does not use."),
        FieldDecl("visited", Several(TEXT), "Paths of nodes that are ticked."),
        FieldDecl("not_visited", Several(TEXT), "Paths of nodes that are never ticked."),
        FieldDecl("ends", WordChoice(("succeeded", "failed", "cancelled")), "How the run ends."),
        FieldDecl("because", TEXT, "Words in the reason why the run ended."),
        FieldDecl("within", DURATION, "Longest time that the run may take."),
        FieldDecl(
            "feedback", Several(WordChoice(tuple(_KINDS))), "The feedback that is given, in order."
        ),
        FieldDecl(
            "told",
            SceneValues(),
            "Values that the tree puts into the scene with 'set', the last of each.",
        ),
        FieldDecl(
            "remembered",
            Entries(ANY, "names and values"),
            "Values that the tree remembers of the person, the last of each.",
        ),
        FieldDecl(
            "cancelled_by", TEXT, "The mood rule's condition, or the reason, that cancels the run."
        ),
    ),
)
_CASE = KeyTable(
    what="a case",
    fields=(
        FieldDecl("name", TEXT, "What is special about this case.", required=True),
        FieldDecl(
            "language",
            NAME,
            "Language of the agent in this case: texts/<language>.yaml; if left out, the file's.",
        ),
        *SCENARIO.fields,
        FieldDecl("expect", _EXPECT, "What the case expects of the run.", required=True),
    ),
)
TEST = FileKind(
    name="test",
    what="a test file",
    title="Test",
    description="Rehearsals of an agent.",
    fields=(
        FieldDecl(
            "test", TEXT, "The agent: its name, or its file beside this one.", required=True
        ),
        FieldDecl(
            "language",
            NAME,
            "Language of the agent in all cases that name none; if left out, the language of the "
            "agent or of scene.yaml.",
        ),
        FieldDecl(
            "cases",
            Items(_CASE, empty="there is no case"),
            "The cases, each a rehearsal.",
            required=True,
        ),
    ),
)


def read_test(file: Path | Source, agents: Iterable[AgentSpec], symbols: SymbolTable) -> AgentTest:
    """Return the cases of a test file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(TEST)
        agent = _agent(reading, fields.get("test"), agents)
        nodes = fields.items("cases")
        cases: dict[str, AgentTestCase] = {}
        if agent is not None:
            languages = _Languages(reading, agent, symbols, fields)
            for node in nodes:
                _case(reading, node, languages, cases)
        reading.problems.raise_if_any()
        assert agent is not None
        return AgentTest(file=reading.source.file, agent=agent, cases=tuple(cases.values()))


def read_scenario_text(text: str, file: str, agent: AgentSpec, symbols: SymbolTable) -> Scenario:
    """Return the scenario in a text, a case without name and expect, like :func:`read_test`."""
    reading = TypedReader(Source(file, text))
    fields = reading.file(SCENARIO)
    scenario = ScenarioReader(reading, agent, symbols).read(fields)
    reading.problems.raise_if_any()
    return scenario


def _agent(
    reading: TypedReader, node: Node | None, agents: Iterable[AgentSpec]
) -> AgentSpec | None:
    text = reading.text(node, "'test'") if node is not None else None
    if node is None or text is None:
        return None
    every = tuple(agents)
    folder = Path(reading.source.file).parent
    file = (folder / text).resolve() if "." in text else None
    for agent in every:
        if text == agent.name or (file is not None and file == Path(agent.file).resolve()):
            return agent
    message = f"there is no agent {quote(text)} without errors"
    hint = did_you_mean(text, [agent.name for agent in every])
    if (broken := _broken(folder, text)) is not None:
        message = f"agent {quote(text)} cannot be tested, as its file has errors"
        hint = f"'bt-agents check {broken}' lists them"
    hint = hint or "'bt-agents check' lists the errors of all agents"
    reading.error("unknown-agent", node, message, hint)
    return None


def _broken(folder: Path, text: str) -> Path | None:
    """Return the file of an existing but unreadable agent."""
    if not _FILE.fullmatch(text):
        return None
    names = (name for name in (text, f"{text}.yaml", f"{text}.yml") if "." in name)
    return next((path for name in names if (path := folder / name).is_file()), None)


def _case(
    reading: TypedReader, node: Node, languages: _Languages, cases: dict[str, AgentTestCase]
) -> None:
    fields = reading.keys(node, _CASE)
    if fields is None:
        return
    name = fields.text("name")
    if name and name in cases:
        reading.error(
            "name-taken",
            fields.nodes["name"],
            f"there is a case {quote(name)} already (line {cases[name].position.line})",
            "say what is different in this one",
        )
    scenarios = languages.scenarios(fields)
    scenario = scenarios.read(fields)
    expected = _Expectations(reading, scenarios, scenario)
    cases[name] = AgentTestCase(
        name=name,
        agent=scenarios.agent,
        scenario=scenario,
        expectations=fields.read("expect", lambda node, _: expected.read(node)) or (),
        position=node.position,
    )


class _Languages:
    """Agent of a test in each language that the file or a case names."""

    def __init__(
        self, reading: TypedReader, agent: AgentSpec, symbols: SymbolTable, file: MappingReader
    ) -> None:
        self._reading = reading
        self._agent = agent
        self._symbols = symbols
        self._usual = ScenarioReader(reading, agent, symbols)
        self._readers: dict[str, ScenarioReader] = {}
        self._usual = self.scenarios(file)

    def scenarios(self, fields: MappingReader) -> ScenarioReader:
        """Return the reader of a case, in its language; report problems of the language."""
        node, language = fields.get("language"), fields.name("language")
        if node is None or not language:
            return self._usual
        if language not in self._readers:
            self._readers[language] = self._in(language, node) or self._usual
        return self._readers[language]

    def _in(self, language: str, node: Node) -> ScenarioReader | None:
        own, texts = self._agent.language, self._symbols.texts
        if own:
            self._reading.error(
                "contradiction",
                node,
                f"the file of {quote(self._agent.name)} says 'language: {own}', which it speaks "
                "whatever the others do",
                "remove 'language' here, or there",
            )
            return None
        known = texts.languages() if texts is not None else []
        if language not in known:
            self._reading.error(
                "unknown-name",
                node,
                f"there are no texts in the language {quote(language)}",
                did_you_mean(language, known) or f"write texts/{language}.yaml",
            )
            return None
        symbols = self._symbols.speaking(language)
        try:
            agent = read_agent(Path(self._agent.file), symbols)
        except ReadError as error:
            first = error.diagnostics[0]
            self._reading.error(
                "unknown-agent",
                node,
                f"{quote(self._agent.name)} has errors in the language {quote(language)}: "
                f"{first.message}",
                "'bt-agents check' lists them",
            )
            return None
        return ScenarioReader(self._reading, agent, symbols)


class _Expectations:
    def __init__(
        self, reading: TypedReader, scenarios: ScenarioReader, scenario: Scenario
    ) -> None:
        self._reading = reading
        self._agent = scenarios.agent
        self._scenarios = scenarios
        self._scenario = scenario

    def read(self, node: Node) -> tuple[Expectation, ...]:
        if isinstance(node, MappingNode) and not node.entries:
            self._reading.error(
                "missing-value", node, "nothing is expected", "add 'ends: succeeded'"
            )
            return ()
        fields = self._reading.keys(node, _EXPECT)
        if fields is None:
            return ()
        expectations = tuple(one for key in fields.nodes for one in self._of_key(key, fields))
        silent = any(isinstance(one, ExpectedBids) and not one.wanted for one in expectations)
        other = next((key for key in fields.nodes if key != "bids"), None)
        if silent and other is not None:
            self._reading.error(
                "contradiction",
                fields.keys[other],
                f"an agent that does not bid does not run, so that '{other}' means nothing",
                "remove it, or write 'bids: true'",
            )
        return expectations

    def _of_key(self, key: str, fields: MappingReader) -> Iterator[Expectation]:
        node, position = fields.nodes[key], fields.keys[key].position
        match key:
            case "bids":
                if (wanted := fields.boolean(key)) is not None:
                    yield ExpectedBids(wanted=wanted, position=position)
            case "says":
                yield self._says(node, position)
            case "does":
                items, exact = self._listed(node, "'does'")
                yield Does(uses=self._uses(items), exact=exact, position=position)
            case "does_not":
                uses = self._uses(several(node), any_skill=True)
                yield DoesNot(uses=uses, position=position)
            case "visited" | "not_visited":
                for item in several(node):
                    if (pattern := self._scenarios.path(item, f"'{key}'")) is not None:
                        wanted = key == "visited"
                        yield Visits(pattern=pattern, wanted=wanted, position=item.position)
            case "ends":
                if (outcome := fields.choice(key)) is not None:
                    yield Ends(outcome=outcome, position=position)
            case "because":
                yield Because(words=fields.text(key), position=position)
            case "within":
                if (seconds := fields.duration(key)) is not None:
                    yield Within(seconds=seconds, position=position)
            case "feedback":
                words = (self._reading.choice(one, "feedback", _KINDS) for one in several(node))
                kinds = tuple(_KINDS[word] for word in words if word is not None)
                yield Teaches(kinds=kinds, position=position)
            case "told":
                told = self._scenarios.told(node, "'told'")
                yield Tells(values=told, position=position)
            case "remembered":
                facts = self._scenarios.facts(fields.entries(key))
                yield Remembers(values=facts, position=position)
            case "cancelled_by":
                if (cause := self._cause(node)) is not None:
                    yield CancelledBy(cause=cause, position=position)

    def _listed(self, node: Node, what: str) -> tuple[tuple[Node, ...], bool]:
        """Return the items of a list, and whether it must be complete."""
        if isinstance(node, MappingNode) and node.get("contains") is not None:
            fields = self._reading.keys(node, _contained(ANY), what)
            inner = fields.get("contains") if fields is not None else None
            return () if inner is None else several(inner), False
        return several(node), True

    def _says(self, node: Node, position: Position) -> Says:
        items, exact = self._listed(node, "'says'")
        read = (
            self._scenarios.plain(item, FieldType.TEXT, "a text that is said") for item in items
        )
        if items and not self._scenarios.skills.keys() & set(SPOKEN):
            self._reading.error(
                "unknown-name",
                node,
                f"the agent's tree uses neither {' nor '.join(map(repr, SPOKEN))}",
                "name its skills under 'does'",
            )
        return Says(
            texts=tuple(str(text) for text in read if text is not None),
            exact=exact,
            position=position,
        )

    def _uses(self, items: Iterable[Node], *, any_skill: bool = False) -> tuple[SkillUse, ...]:
        """Return uses of skills, with ``any_skill`` also of skills outside the agent's trees."""
        return readable(self._use(item, any_skill) for item in items)

    def _use(self, node: Node, any_skill: bool) -> SkillUse | None:
        if isinstance(node, Scalar):
            text = self._reading.text(node, "a skill that is used")
            skill = self._skill(node, text, any_skill) if text is not None else None
            return None if skill is None else SkillUse(skill=skill.name)
        if not isinstance(node, MappingNode) or len(node.entries) != 1:
            self._reading.wrong_type(node, "'does'", "one skill an item, such as 'say: Hello.'")
            return None
        entry = node.entries[0]
        skill = self._skill(entry.key, entry.key.text, any_skill)
        if skill is None:
            return None
        types = {one.name: one.type for one in skill.inputs}
        if isinstance(entry.value, MappingNode):
            inputs = self._inputs(entry.value, skill.name, types)
            return SkillUse(skill=skill.name, inputs=inputs, main=skill.main)
        if skill.main is None:
            self._reading.wrong_type(
                entry.value, f"'{skill.name}'", "a mapping of inputs", Shape.MAPPING
            )
            return None
        value = self._scenarios.plain(entry.value, types[skill.main], f"'{skill.main}'")
        return SkillUse(skill=skill.name, inputs={skill.main: value}, main=skill.main)

    def _inputs(
        self, node: MappingNode, skill: str, types: Mapping[str, FieldType]
    ) -> dict[str, Plain]:
        values: dict[str, Plain] = {}
        for entry in node.entries:
            name = entry.key.text
            if types and name not in types:
                self._reading.error(
                    "unknown-key",
                    entry.key,
                    f"'{skill}' has no input {quote(name)}",
                    did_you_mean(name, types),
                )
                continue
            field_type = types.get(name, FieldType.ANY)
            values[name] = self._scenarios.plain(entry.value, field_type, f"'{name}'")
        return values

    def _skill(self, node: Scalar, name: str, any_skill: bool) -> SkillSpec | None:
        known = self._scenarios.known_skills if any_skill else self._scenarios.skills
        skill = known.get(name)
        if skill is None:
            problem = "there is no skill" if any_skill else "the agent's tree uses no skill"
            self._scenarios.refuse_name(node, problem, name, known)
        return skill

    def _cause(self, node: Node) -> str | None:
        """Return the cause that cancels the run: the condition of a mood rule, or a reason."""
        text = self._reading.text(node, "'cancelled_by'")
        if text is None:
            return None
        rules = [rule.when.text for rule in self._agent.rules if rule.action is MoodAction.CANCEL]
        cancelled = (one.cancel for one in self._scenario.during)
        known = [*rules, *(one.reason for one in cancelled if one is not None)]
        cause = next((one for one in known if one.split() == text.split()), None)
        if cause is None:
            problem = "nothing cancels this run for"
            hint = (
                "give a rule under 'feedback' of the agent 'then: cancel', or cancel under "
                "'during'"
            )
            self._scenarios.refuse_name(node, problem, text, known, hint)
        return cause
