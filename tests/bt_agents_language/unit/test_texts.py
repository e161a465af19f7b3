# SPDX-License-Identifier: Apache-2.0
"""Texts of a language and variants of a text: files, references, checks, drawing and export."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from agent_texts import agent_of, refusal
from bt_agents_core.errors import BtAgentsError
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent
from bt_agents_language.diagnostics.renderers import as_line
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.files.texts_reader import FolderTexts, read_texts
from bt_agents_language.model.specs import Literal, NodeSpec, Reference, Text, Variants
from bt_agents_language.tools.drawing.value_format import format_value
from bt_agents_language.tools.folder_check import check_folder
from bt_agents_language.tools.lint import lint
from bt_agents_language.tools.schema.folder import schema_of
from bt_agents_language.yaml.source import Source
from core_schema import loaded
from file_texts import read_agent_text
from tree_harness import SYMBOLS, TREES, agent

SCENE = (TREES / "scene.yaml").read_text() + "\nlanguage: de\n"
HEAD = "format: 1\nagent: guide\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
DE = "format: 1\ntexts:\n  hello: Hallo.\n  ask: Fertig, ${guest}?\n"
EN = "format: 1\ntexts:\n  hello: Hello.\n  ask: Ready, ${guest}?\n"
TREE = """tree:
  sequence:
    - set: {guest: Ann}
    - say: ${t.hello}
    - ask: "${t.ask}"
"""


class Folder:
    """A trees folder with one agent and texts in two languages."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.write("scene.yaml", SCENE)
        self.write("skills/robot.yaml", (TREES / "skills" / "robot.yaml").read_text())
        self.write("texts/de.yaml", DE)
        self.write("texts/en.yaml", EN)
        self.tree(TREE)

    def write(self, name: str, text: str) -> None:
        (self.path / name).parent.mkdir(exist_ok=True)
        (self.path / name).write_text(text, encoding="utf-8")

    def tree(self, text: str) -> None:
        self.write("agents/guide.yaml", HEAD + text)

    def read(self, language: str = "") -> Trees:
        return read_trees(self.path, language=language)

    def said(self, tree: str, language: str = "") -> object:
        self.tree(f"tree:\n  say: {tree}\n")
        trees = self.read(language)
        assert not trees.broken, trees.broken[0].error
        return trees.agents[0].tree.fields["text"]

    def problems(self) -> list[str]:
        return [
            "/".join(Path(one.position.file).parts[-2:])
            + f":{one.position.line}:{one.position.column}: {one.code}: {one.message} | {one.hint}"
            for one in check_folder(self.path).problems
        ]


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


def test_text_follows_requested_or_folder_language(folder):
    assert folder.said("${t.hello}") == Literal(value="Hallo.")
    assert folder.said("${t.hello}", "en") == Literal(value="Hello.")


def test_text_names_resolve_at_insertion_point(folder):
    tree = folder.read().agents[0].tree
    assert tree.children[2].fields["text"] == Text(
        parts=("Fertig, ", Reference(name="guest"), "?")
    )
    assert folder.problems() == []


def test_text_can_be_inserted_inside_texts_and_lists(folder):
    assert folder.said('"${t.hello} ${t.hello}!"') == Literal(value="Hallo. Hallo.!")
    folder.tree('tree: {ask: {text: a, choices: ["${t.hello}", no]}}\n')
    choices = folder.read().agents[0].tree.fields["choices"].items
    assert [item.value for item in choices] == ["Hallo.", "no"]


def test_text_variants_are_allowed_only_in_skills(folder):
    folder.write("texts/de.yaml", DE + "  bye: {one_of: [Ade., 'Bis ${clock.weekday}.']}\n")
    variants = folder.said("${t.bye}")
    assert isinstance(variants, Variants)
    assert variants.texts[0] == Literal(value="Ade.")
    inside = folder.said('"Gut. ${t.bye}"')
    assert isinstance(inside, Text)
    assert inside.parts == ("Gut. ", variants)
    folder.tree('tree: {log: "${t.bye}"}\n')
    (broken,) = folder.read().broken
    assert "'t.bye' is one of several texts" in broken.error.lines[0]


def test_longest_variant_decides_cut_speech_warning(folder):
    long = "Bitte legen Sie Ihre Tasche auf die Plattform, wenn Sie so weit sind."
    folder.write("texts/de.yaml", f"{DE}  bye: {{one_of: [Ade., '{long}']}}\n")
    folder.tree('tree: {say: "Gut. ${t.bye}", timeout: 3 s}\n')
    assert [one.code for one in lint(folder.read().agents[0])] == ["cut-speech"]


def test_comment_in_text_gets_warning_in_its_file(folder):
    folder.write("texts/de.yaml", DE + "  bye: Ade. // laut\n")
    folder.tree("tree: {say: '${t.bye}'}\n")
    found = [one for one in folder.problems() if "comment-in-text" in one]
    assert [one.partition(": '")[0] for one in found] == ["texts/de.yaml:5:13: comment-in-text"]


def test_condition_may_compare_with_plain_text(folder):
    folder.tree("tree: {sequence: [ask: a, check: 'lower(answer) == t.hello']}\n")
    condition = folder.read().agents[0].tree.children[1].fields["condition"]
    assert condition.evaluate(lambda _: "HALLO") is False
    folder.write("texts/de.yaml", DE.replace("Hallo.", "hallo"))
    again = folder.read().agents[0].tree.children[1].fields["condition"]
    assert again.evaluate(lambda _: "HALLO") is True
    assert again != condition
    folder.tree("tree: {sequence: [ask: a, check: answer == t.ask]}\n")
    (broken,) = folder.read().broken
    assert "'t.ask' has a name in it, which an expression cannot fill in" in broken.error.lines[0]


def test_text_errors_are_positioned_for_every_language(folder):
    folder.write("texts/en.yaml", EN.replace("${guest}", "${gest}"))
    assert folder.problems() == [
        "texts/en.yaml:4:17: unknown-name: there is no name 'gest' here | did you mean 'guest'?"
    ]
    (problem,) = check_folder(folder.path).problems
    assert problem.inserted == (f"{folder.path}/agents/guide.yaml:8",)
    assert not folder.read().broken
    assert folder.read("en").broken


def test_wrong_text_is_one_problem(folder):
    folder.write("texts/de.yaml", DE.replace("${guest}", "${gest}"))
    tree = "tree: {sequence: [{set: {guest: Ann}}, {say: '${t.ask}'}, {show: '${t.ask}'}]}\n"
    for name in ("ann", "bob"):
        folder.write(f"agents/{name}.yaml", HEAD.replace("guide", name) + tree)
    [problem] = check_folder(folder.path).problems
    assert as_line(problem).endswith(
        f"'gest' here (inserted in {folder.path}/agents/ann.yaml:4 and 2 other places)"
    )
    assert folder.read().report.count("there is no name 'gest' here") == 1


def test_unknown_text_error_suggests_nearest_text(folder):
    folder.tree('tree: {say: "${t.helo}"}\n')
    (first, *_) = folder.problems()
    assert first == (
        "agents/guide.yaml:4:16: unknown-name: there is no text 'helo' in texts/de.yaml | "
        "did you mean 't.hello'?"
    )


def test_missing_and_unused_texts_are_reported(folder):
    folder.write("texts/de.yaml", DE + "  bye: Ade.\n")
    assert folder.problems() == [
        "texts/de.yaml:5:3: unused-text: nothing inserts the text 'bye' | "
        "write ${t.bye} where it is needed, or remove it",
        "texts/en.yaml:1:1: missing-text: there is no text 'bye', which de.yaml has | "
        "add 'bye: …' below 'texts'",
    ]


def test_agent_language_applies_to_its_imported_libraries(folder):
    folder.write("texts/de.yaml", DE + "  bye: Ade.\n")
    folder.write("texts/en.yaml", EN + "  bye: Bye.\n")
    library = 'format: 1\nsubtrees: {leave: {tree: {say: "${t.bye}"}}}\n'
    folder.write("libraries/manners.yaml", library)
    tree = "imports: [libraries/manners.yaml]\n" + TREE + "    - subtree: leave\n"
    folder.tree(tree)
    folder.write("agents/english.yaml", f"{HEAD.replace('guide', 'english')}language: en\n{tree}")
    trees = folder.read()
    assert not trees.broken
    said = {
        agent.name: (
            agent.tree.children[1].fields["text"].value,
            agent.tree.children[3].children[0].fields["text"].value,
        )
        for agent in trees.agents
    }
    assert said == {"guide": ("Hallo.", "Ade."), "english": ("Hello.", "Bye.")}
    imports = {one.agent.name: one.imports for one in trees.files}
    assert imports["english"] == {"libraries/manners.yaml", "texts/en.yaml"}
    assert folder.problems() == []


def test_agent_language_without_texts_is_an_error(folder):
    folder.tree("language: fr\n" + TREE)
    (first, *_) = folder.problems()
    assert "there are no texts in the language 'fr'" in first


def test_texts_without_language_are_rejected_with_hint(folder):
    folder.write("scene.yaml", SCENE.replace("language: de\n", ""))
    (broken,) = folder.read().broken
    (problem,) = broken.error.diagnostics
    assert "no language is chosen for the texts that this file inserts" in problem.message
    assert "write 'language: de or en' in scene.yaml" in problem.hint
    assert not folder.read("en").broken


def test_language_without_texts_is_rejected(folder):
    with pytest.raises(BtAgentsError, match=r"no texts in the language 'fr'.*some in de and en"):
        folder.read("fr")
    with pytest.raises(BtAgentsError, match="no texts in the language"):
        folder.read("../agents/guide")
    assert FolderTexts(folder.path, "../agents/guide").broken is None
    shutil.rmtree(folder.path / "texts")
    with pytest.raises(BtAgentsError, match=r"no texts in the language 'fr'.*; there are none$"):
        folder.read("fr")


def test_broken_text_file_breaks_only_its_users(folder):
    folder.write("texts/de.yaml", "format: 1\ntexts: 3\n")
    folder.write("agents/plain.yaml", HEAD.replace("guide", "plain") + "tree: {say: Hello.}\n")
    trees = folder.read()
    assert [one.name for one in trees.agents] == ["plain"]
    assert [one.file.name for one in trees.broken] == ["guide.yaml", "de.yaml"]
    report = trees.broken[0].error.report
    assert "'texts/de.yaml' has errors itself: wrong-type in line 2" in report


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        ("{}", "there is no text"),
        ("{Hello: a}", "[bad-name]"),
        ("{hello: }", "text 'hello' is empty"),
        ("{hello: [a, b]}", "expected a text, found a list"),
        ("{hello: {one_of: [a]}}", "text 'hello' needs two texts or more, found 1"),
        ("{hello: {one_off: [a, b]}}", "[unknown-key]"),
        ("{hello: {one_of: [a, {b: c}]}}", "expected a text, found a mapping"),
    ],
)
def test_text_file_errors_are_reported(texts, problem):
    source = Source("de.yaml", f"format: 1\ntexts: {texts}\n")
    assert problem in refusal(read_texts, source).report


def test_text_cannot_insert_another_text(folder):
    folder.write("texts/de.yaml", "format: 1\ntexts: {hello: '${t.hello}', ask: b}\n")
    (broken,) = folder.read().broken
    first = broken.error.diagnostics[0]
    assert first.message.startswith("a text cannot insert another one, 't.hello'")
    assert Path(first.position.file).name == "de.yaml"
    assert "${t.hello}" in first.excerpt


def test_shared_text_problem_is_reported_once(folder):
    folder.write("scene.yaml", SCENE.replace("language: de\n", ""))
    folder.tree(TREE + "    - when: \"'a' == t.hello\"\n      say: ${t.hello}\n")
    (broken,) = folder.read().broken
    assert [one.code for one in broken.error.diagnostics] == ["no-texts"]
    folder.write("texts/de.yaml", "texts: 3\n")
    folder.write("scene.yaml", SCENE)
    (agent, _) = folder.read().broken
    assert [one.code for one in agent.error.diagnostics] == ["no-texts"]


TEST = """format: 1
test: guide
cases:
  - name: it greets
    expect: {says: {contains: ["${t.hello}"]}}
  - name: it greets in English
    language: en
    answers: {ask: "${t.hello}"}
    expect: {says: [Hello., "Ready, Ann?"]}
"""


def read_cases(folder, text=TEST):
    folder.write("agents/guide.test.yaml", text)
    trees = folder.read()
    return read_test(folder.path / "agents/guide.test.yaml", trees.agents, trees.symbols)


def refused(folder, text):
    (one,) = refusal(read_cases, folder, text).diagnostics
    return one


def test_case_uses_its_declared_language(folder):
    test = read_cases(folder)
    german, english = test.cases
    (says,) = german.expectations
    assert says.texts == ("Hallo.",)
    assert german.agent is test.agent
    assert english.agent.tree.children[1].fields["text"] == Literal(value="Hello.")
    assert english.scenario.answers[0].answers[0].outputs == {"answer": "Hello."}


def test_test_file_language_is_default_of_its_cases(folder):
    text = TEST.replace("language: en", "language: de")
    english, german = read_cases(folder, text.replace("cases:", "language: en\ncases:")).cases
    (says,) = english.expectations
    assert says.texts == ("Hello.",)
    assert german.scenario.answers[0].answers[0].outputs == {"answer": "Hallo."}


@pytest.mark.parametrize(
    ("old", "new"), [("cases:", "language: eng\ncases:"), ("language: en", "language: eng")]
)
def test_test_in_language_without_texts_is_rejected(folder, old, new):
    problem = refused(folder, TEST.replace(old, new))
    assert problem.message == "there are no texts in the language 'eng'"
    assert problem.hint == "did you mean 'en'?"


def test_case_cannot_override_language_of_agent(folder):
    folder.tree("language: de\n" + TREE)
    problem = refused(folder, TEST)
    assert problem.code == "contradiction"
    assert "says 'language: de'" in problem.message


def test_case_in_language_with_broken_agent_is_rejected(folder):
    folder.write("texts/en.yaml", "format: 1\ntexts: {ask: Ready?}\n")
    problem = refused(folder, TEST)
    assert "'guide' has errors in the language 'en': there is no text 'hello'" in problem.message


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Ready, ${guest}?", "'t.ask' has ${…} in it, which only the agent can fill in"),
        ("{one_of: [Ready?, Done?]}", "'t.ask' is one of several texts, and a test needs a"),
    ],
)
def test_test_inserts_only_complete_texts(folder, text, why):
    folder.write("texts/de.yaml", f"format: 1\ntexts:\n  hello: Hallo.\n  ask: {text}\n")
    problem = refused(folder, TEST.replace('t.hello}"]}}', 't.ask}"]}}'))
    assert why in problem.message
    assert "write what is said, such as 'Ready" in problem.hint


SCHEMA = Draft7Validator(schema_of(AGENT, SYMBOLS))


def node(tree: str) -> NodeSpec:
    return agent(tree).tree


def refused_by_schema(tree: str) -> bool:
    return bool(list(SCHEMA.iter_errors(loaded(f"{HEAD}tree: {{{tree}}}\n"))))


def test_variants_replace_main_text_beside_other_inputs():
    spec = node("say: {one_of: [Hello., Hi.], rate: 0.8}")
    assert spec.fields["text"] == Variants(texts=(Literal(value="Hello."), Literal(value="Hi.")))
    assert spec.fields["rate"] == Literal(value=0.8)
    assert spec.name == "say one_of …"
    assert not refused_by_schema("say: {one_of: [Hello., Hi.], rate: 0.8}")


@pytest.mark.parametrize(
    ("tree", "code", "message", "hint", "by_schema"),
    [
        ("say: {one_of: [Hello.]}", "missing-value", "needs two texts or more", "without", True),
        ("say: {one_of: Hello.}", "wrong-type", "expected a list of texts", "'- '", True),
        ("say: {one_of: [Hello., [a]]}", "wrong-type", "expected a text", "", True),
        ("say: {one_of: [a, b], text: c}", "contradiction", "replaces it", "keep one", False),
        ("say: [a, b]", "wrong-type", "found a list", "write {one_of: […]}", True),
        ("drive: {oneof: [a, b]}", "unknown-key", "no key 'oneof'", "'one_of'", True),
        ("say: {one_of: [a, 'b ${nmae}']}", "unknown-name", "no name 'nmae'", "", False),
        ("say: {rate: {one_of: [1, 2]}, text: a}", "wrong-type", "expected a number", "", True),
        ("log: {one_of: [a, b]}", "unknown-key", "no key 'one_of'", "", True),
    ],
)
def test_variant_errors_are_reported(tree, code, message, hint, by_schema):
    [found] = [one for one in refusal(agent, tree).diagnostics if one.code == code]
    assert message in found.message
    assert hint in found.hint
    assert refused_by_schema(tree) is by_schema


def test_drawing_shows_all_variants():
    shown = format_value(node("say: {one_of: [Hello., 'Hi ${clock.hour}.']}").fields["text"])
    assert shown == 'one of "Hello.", "Hi ${clock.hour}."'


def test_groot_round_trip_keeps_variants():
    ask = "{one_of: ['Shall we?', 'Ready, ${clock.weekday}?'], choices: [yes, no], wait: 3 s}"
    keys = f"tree: {{ask: {ask}}}\n"
    exported = export_agent(Source("a.yaml", HEAD + keys), SYMBOLS)
    imported = import_agent(Source("a.xml", exported.text), "a", SYMBOLS)
    after = read_agent_text(imported.text, "a.yaml", SYMBOLS)
    assert after.tree.fields == agent_of(keys).tree.fields
