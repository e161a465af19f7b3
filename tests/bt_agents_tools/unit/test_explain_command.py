# SPDX-License-Identifier: Apache-2.0
"""`bt-agents explain`: pages of the reference in the terminal."""

from __future__ import annotations

import io
import shutil
import sys

import pytest
from click.testing import CliRunner
from rich.console import Console

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.reference.codes import codes
from bt_agents_language.reference.file_pages import file_words
from bt_agents_language.reference.node_pages import node_pages
from bt_agents_tools.cli.commands.explain import explain, explanation, print_page
from bt_agents_tools.cli.installed_kinds import installed_kinds
from command_results import split_runner
from tree_harness import SYMBOLS, TREES


def explained(word: str = "") -> str:
    result = CliRunner().invoke(
        explain, [*([word] if word else []), "--dir", str(TREES)], catch_exceptions=False
    )
    assert result.exit_code == 0
    assert not [line for line in result.output.splitlines() if line.endswith(" ")]
    return result.output.strip()


def page(word: str) -> str:
    console = Console(file=io.StringIO(), width=100)
    print_page(console, explanation(word, SYMBOLS))
    return console.file.getvalue()


def test_code_page_shows_meaning_and_two_examples():
    text, right = explained("two-nodes").split("\n\nRight:\n")
    meaning, wrong = text.split("\n\nWrong:\n")
    assert meaning == "error[two-nodes]  part of an agent file\n\nOne item contains two nodes."
    assert wrong == "  tree:\n    sequence:\n      - say: Hello.\n        wait: 2 s"
    assert right == "  tree:\n    sequence:\n      - say: Hello.\n      - wait: 2 s"


@pytest.mark.parametrize("word", ["error[tab]", "error[tab]:", "tab", " tab:"])
def test_code_can_be_pasted_from_report(word):
    assert page(word).startswith("error[tab]")


@pytest.mark.parametrize("code", codes())
def test_every_code_has_a_page(code):
    assert codes()[code].meaning.split()[0] in page(code)


@pytest.mark.parametrize(
    "word", sorted({page.key for page in node_pages(SYMBOLS)} | {*file_words(installed_kinds())})
)
def test_every_language_keyword_and_file_key_has_page(word):
    assert page(word).startswith(f"{word}  ")


def test_example_is_never_cut_on_narrow_terminal():
    console = Console(file=io.StringIO(), width=40)
    print_page(console, explanation("wait_for", SYMBOLS))
    line = "      - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}\n"
    assert line in console.file.getvalue()


def test_library_subtree_page_lists_its_importers():
    text = explained("greet")
    assert text.startswith("greet  subtree of a library\n\nOne of three greetings, so that nobody")
    assert "\n  subtree: greet\n  with: {rate: …}\n" in text
    assert "\n  rate   number  1         speed of speech\n" in text
    assert "\nDeclared in libraries/manners.yaml, which an agent imports.\n\nExample:\n" in text
    assert text.endswith("\n    subtree: greet\n    with: {rate: 1}")


def test_broken_library_explains_nothing(tmp_path):
    folder = tmp_path / "trees"
    shutil.copytree(TREES, folder)
    (folder / "libraries" / "odd.yaml").write_text("format: 1\n", encoding="utf-8")
    result = CliRunner().invoke(explain, ["--dir", str(folder)], catch_exceptions=False)
    assert "clear_the_way\n" in result.output
    assert "odd.yaml" not in result.output


def test_missing_argument_lists_all_words():
    words = {"sequence", "say", "retry", "greet", "units", "unknown-node", "BUSY"}
    assert words | {*installed_kinds()} <= set(explained().split())


def test_file_kind_page_lists_its_keys():
    assert explained("market") == (
        "market  file\n"
        "\n"
        "Rules by which the market chooses an agent.\n"
        "\n"
        "  field  value                left out\n"
        "  rules  list, each: mapping  needed    For the strategy 'rules': the first one\n"
        "                                        that holds counts."
    )


def test_sweep_page_requires_installed_lab(monkeypatch):
    text = page("sweep")
    assert text.startswith("sweep  file\n\nRuns of strategies and learning rules")
    assert "arrivals" in text
    assert "key of a sweep" in page("strategies")
    monkeypatch.setitem(sys.modules, "bt_agents_lab.experiments.sweep_reader", None)
    assert "sweep" not in explained().split()
    with pytest.raises(BtAgentsError, match="there is no word or code 'sweep'"):
        page("sweep")


@pytest.mark.parametrize(
    ("word", "texts"),
    [
        ("NOT_PAUSED:", ["NOT_PAUSED a refusal at run time", RefusalCode.NOT_PAUSED.sentence]),
        ("ask", ["ask skill Ask a question", "ask: {text: …, choices: …, wait: …}", "needed"]),
        ("ask", ["${answer} (text) the person's answer"]),
        ("units", ["length mm, cm, m or km, for example 1.5 m; a bare number is in m"]),
        ("expressions", ["lower(text) the text in small letters"]),
        ("cancel.by", ["live.mood live.person live.stale the others have no value"]),
        ("tunables", ["tunables key of an agent file Values that may change"]),
        ("tunables", ["tunables: names and tunables", "2, 2.0, 8 s, true, a text."]),
        ("seed", ["seed key below 'cases' of a test file", "seed key of an experiment"]),
        ("seed", ["whole number, 0 or more"]),
        ("publish", ["publish leaf", "publish key below 'during' of a test file"]),
        ("scene", ["scene file", "scene key below 'visits' of a script"]),
        ("format", ["format key of every file"]),
        ("contains", ["contains key below 'says'"]),
        ("until", ["until key of wait_for", "until key of repeat"]),
    ],
)
def test_page_tells_every_meaning_of_its_word(word, texts):
    text = " ".join(explained(word).split())
    assert [one for one in texts if one not in text] == []


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("sya", "did you mean 'say'?"),
        ("unknown_node", "did you mean 'unknown-node'?"),
        ("clear_way", "did you mean 'clear_the_way'?"),
        ("learning_rat", "did you mean 'learning_rate'?"),
        ("qqqqqq", "'bt-agents explain' lists all"),
    ],
)
def test_unknown_word_suggests_most_similar(word, hint):
    with pytest.raises(BtAgentsError) as error:
        CliRunner().invoke(explain, [word, "--dir", str(TREES)], catch_exceptions=False)
    assert str(error.value) == f"there is no word or code '{word}'; {hint}"


def test_language_is_explained_without_trees_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    result = split_runner().invoke(explain, ["wait"], catch_exceptions=False)
    assert "Waits for a time." in result.stdout
    assert "without the skills of a trees folder" in result.stderr
