# SPDX-License-Identifier: Apache-2.0
"""Corpus files that are generated, because they are too large to store or not regular files."""

from __future__ import annotations

import os
import random
import string
from collections.abc import Mapping
from pathlib import Path

from bt_agents_language.tree.subtrees import MAX_NODES

HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
MIB = 1024 * 1024


def tree(text: str, head: str = "") -> bytes:
    """Return an agent file whose tree starts in the line after ``tree:``."""
    return f"{HEAD}{head}tree:\n  {text}\n".encode()


def words(count: int, seed: int = 0) -> list[str]:
    """Return random words, all different."""
    source = random.Random(seed)
    return [
        "".join(source.choices(string.ascii_lowercase, k=24)) + str(number)
        for number in range(count)
    ]


def chain(count: int) -> str:
    """Return subtrees that each call the next one."""
    lines = [f"  s{i}: {{tree: {{subtree: s{i + 1}}}}}" for i in range(count - 1)]
    return "\n".join([*lines, f"  s{count - 1}: {{tree: {{say: x}}}}"])


TUNABLES = "tunables:\n" + "".join(f"  {word}: {{default: x}}\n" for word in words(500))
NEAR = " ".join(f"${{{word[:-1]}x}}" for word in words(400))

BUILT: Mapping[str, bytes] = {
    # Size.
    "agents/one_byte_too_many.yaml": HEAD.encode() + b"#" * (MIB - len(HEAD) + 1),
    "agents/valid_one_mebibyte.yaml": tree("say: x") + b"#" * (MIB - len(tree("say: x"))),
    "agents/valid_blank_lines.yaml": HEAD.encode() + b"\n" * 900_000 + b"tree: {say: x}\n",
    "agents/valid_many_comments.yaml": HEAD.encode() + b"# x\n" * 200_000 + b"tree: {say: x}\n",
    "agents/endless_line.yaml": tree("s" * 500_000 + ": x"),
    "agents/endless_quoted_key.yaml": tree('"' + "s" * 900 + '": x'),
    "agents/long_text.yaml": tree("say: " + "la " * 10_000),
    "agents/long_folded_text.yaml": tree("say: >\n" + "    la la la\n" * 3_000),
    "agents/long_quoted_blanks.yaml": tree('say: "x' + " " * 900_000 + 'x"'),
    "agents/long_escapes.yaml": tree('say: "' + "\\x41" * 20_001 + '"'),
    "agents/long_quotes.yaml": tree("say: '" + "''" * 100_000 + "'"),
    "agents/long_tag.yaml": tree("say: !" + "t" * 300_000 + " x"),
    "agents/long_anchor.yaml": tree("say: &" + "a" * 300_000 + " x"),
    "agents/long_number.yaml": tree("wait: " + "9" * 19_000),
    "agents/long_fraction.yaml": tree("wait: 0." + "0" * 19_000 + "1 s"),
    "agents/long_almost_number.yaml": tree("wait: " + "1 " * 9_000 + "!"),
    "agents/long_name.yaml": f"{HEAD}tree: {{say: x}}\n".replace(
        "agent: a", "agent: " + "a" * 19_000
    ).encode(),
    "agents/long_topic.yaml": tree(
        "publish: {topic: /" + "a/" * 9_000 + "b, type: a/msg/B, message: {}}"
    ),
    "agents/many_tags.yaml": HEAD.encode() + b"tags: [" + b"a," * 60_000 + b"a]\ntree: {say: x}\n",
    "agents/many_keys.yaml": HEAD.encode()
    + b"".join(b"k%d: 1\n" % i for i in range(40_000))
    + b"tree: {say: x}\n",
    # Nesting.
    "agents/deep_brackets.yaml": tree("say: " + "[" * 200_000),
    "agents/deep_braces.yaml": tree("say: " + "{" * 200_000),
    "agents/deep_dashes.yaml": tree("- " * 100_000 + "x"),
    "agents/deep_question_marks.yaml": tree("? " * 100_000 + "x"),
    "agents/deep_indentation.yaml": HEAD.encode()
    + b"".join(b" " * i + b"sequence:\n" for i in range(1_000)),
    "agents/deep_sequences.yaml": tree("{sequence: [" * 40 + "{say: x}" + "]}" * 40),
    "agents/valid_deep_sequences.yaml": tree("{sequence: [" * 30 + "{say: x}" + "]}" * 30),
    "agents/deep_handlers.yaml": tree("{say: x, on_failure: " * 70 + "{say: x}" + "}" * 70),
    "agents/deep_modifiers.yaml": HEAD.encode()
    + b"tree: {subtree: s0, retry: 2, timeout: 5 s}\nsubtrees:\n"
    + b"".join(
        b"  s%d: {tree: {subtree: s%d, retry: 2, timeout: 5 s}}\n" % (i, i + 1) for i in range(30)
    )
    + b"  s30: {tree: {say: x}}\n",
    # Repetition by reference.
    "agents/billion_laughs.yaml": HEAD.encode()
    + b"tags: &a [x, x]\n"
    + b"".join(b"k%c: &%c [*%c, *%c]\n" % (c, c, c - 1, c - 1) for c in b"bcdefghi")
    + b"tree: {say: x}\n",
    "agents/long_chain_of_subtrees.yaml": (
        f"{HEAD}tree: {{subtree: s0}}\nsubtrees:\n{chain(3_000)}\n".encode()
    ),
    "agents/long_circle_of_subtrees.yaml": (
        f"{HEAD}tree: {{subtree: s0}}\nsubtrees:\n{chain(1_000)}\n".replace(
            "{say: x}", "{subtree: s0}"
        ).encode()
    ),
    "agents/wide_sequence.yaml": tree("sequence:\n" + "    - say: x\n" * MAX_NODES),
    "agents/valid_wide_sequence.yaml": tree("sequence:\n" + "    - say: x\n" * (MAX_NODES - 1)),
    "agents/tall_fan.yaml": (
        f"{HEAD}tree: {{subtree: s0}}\nsubtrees:\n"
        + "".join(
            f"  s{i}: {{tree: {{sequence: [{{subtree: s{i + 1}}}, {{subtree: s{i + 1}}}]}}}}\n"
            for i in range(25)
        )
        + "  s25: {tree: {say: x}}\n"
    ).encode(),
    # Punctuation.
    "agents/commas.yaml": tree("say: [" + "," * 300_000),
    "agents/colons.yaml": tree(": " * 100_000),
    "agents/open_quotes.yaml": tree("say: " + '"' * 99_999),
    "agents/conflict_marks.yaml": b"<<<<<<< a\n" * 90_000,
    "agents/many_slips.yaml": HEAD.encode()
    + b"".join(b"k%d:x\n" % i for i in range(20_000))
    + b"tree: {say: x}\n",
    "agents/many_open_brackets.yaml": HEAD.encode()
    + b"".join(b"k%d: [a\n" % i for i in range(20_000)),
    "agents/slips_behind_much.yaml": HEAD.encode()
    + b"tags: ["
    + b"a," * 49_000
    + b"a]\n"
    + b"".join(b"k%d:x\n" % i for i in range(90)),
    "agents/many_tabs.yaml": HEAD.encode() + b"tree:\n" + b"\tsay: x\n" * 50_000,
    "agents/percent_signs.yaml": b"%" * 300_000,
    "agents/null_bytes.yaml": b"\0" * 300_000,
    "agents/random_bytes.yaml": random.Random(7).randbytes(300_000),
    "agents/block_marks.yaml": tree("say: |\n" + "  |\n" * 5_000),
    # Expressions and references.
    "agents/deep_condition.yaml": tree("check: " + "(" * 5_000 + "true" + ")" * 5_000),
    "agents/long_condition.yaml": tree("check: " + "scene.age + " * 1_500 + "1 > 0"),
    "agents/many_nots.yaml": tree("check: " + "not " * 4_500 + "true"),
    "agents/many_minuses.yaml": tree("check: " + "-" * 18_000 + "1 < 0"),
    "agents/open_quote_in_condition.yaml": tree("check: scene.age == '" + "x" * 15_000),
    "agents/long_list_in_condition.yaml": tree("check: scene.age in [" + "1, " * 6_000 + "2]"),
    "agents/open_references.yaml": tree("say: " + "${" * 9_000),
    "agents/deep_references.yaml": tree("say: " + "${" * 4_000 + "x" + "}" * 4_000),
    "agents/valid_many_references.yaml": tree("say: " + "${scene.age} " * 1_500),
    "agents/valid_many_dollars.yaml": tree("say: " + "$" * 19_000),
    # Messages that are expensive to produce.
    "agents/many_near_misses.yaml": tree("say: " + NEAR, TUNABLES),
    "agents/many_unknown_nodes.yaml": tree(
        "sequence:\n" + "".join(f"    - {word}: x\n" for word in words(450, seed=1))
    ),
    "agents/many_folded_slips.yaml": tree("say: >\n" + "    la ${nobody} la\n" * 450),
    "imports/libraries/large.yaml": b"#" * (MIB + 1),
    **{
        f"imports/libraries/chain_{i}.yaml": (
            f"format: 1\nimports: [libraries/chain_{i + 1}.yaml]\nsubtrees: {{s{i}: "
            "{tree: {say: x}}}\n"
        ).encode()
        for i in range(300)
    },
}
"""Path in the corpus → content."""

UNLISTED = ("imports/libraries/chain_", "imports/libraries/large.yaml")
"""Files without an expectation of their own: an agent imports them."""


NO_FILES = tuple(
    f"agents/{name}.yaml" for name in ("pipe", "folder", "device", "dead_link", "link_to_itself")
)
"""Paths of files that are not regular files."""


def build(corpus: Path) -> None:
    """Add the generated files to a copy of the corpus."""
    for name, content in BUILT.items():
        (corpus / name).write_bytes(content)
    outside = corpus.parent / "outside"
    outside.mkdir()
    text = "format: 1\nsubtrees:\n  greet: {tree: {say: Hello.}}\n"
    (outside / "greetings.yaml").write_text(text, encoding="utf-8")
    folder = corpus / "imports" / "libraries"
    (folder / "link_outside.yaml").symlink_to(outside / "greetings.yaml")
    (folder / "link_inside.yaml").symlink_to(folder / "greetings.yaml")
    (folder / "link_to_itself.yaml").symlink_to(folder / "link_to_itself.yaml")
    (folder / "dead_link.yaml").symlink_to(folder / "nothing.yaml")
    (folder / "endless.yaml").symlink_to("/dev/zero")
    (folder / "folder.yaml").mkdir()
    os.mkfifo(folder / "pipe.yaml")
    (corpus / "imports" / "linked_folder").symlink_to(outside)
    os.mkfifo(corpus / "agents" / "pipe.yaml")
    (corpus / "agents" / "folder.yaml").mkdir()
    (corpus / "agents" / "dead_link.yaml").symlink_to(corpus / "nothing.yaml")
    (corpus / "agents" / "link_to_itself.yaml").symlink_to(corpus / "agents/link_to_itself.yaml")
    (corpus / "agents" / "device.yaml").symlink_to("/dev/zero")
