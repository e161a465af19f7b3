# SPDX-License-Identifier: Apache-2.0
"""Codes for files as such and for the form of YAML, before anything in them has a meaning."""

from __future__ import annotations

from bt_agents_language.reference.codes.entry import FileKind, error

TEXT_CODES = (
    error(
        "no-file",
        "The file does not exist or may not be read.",
        """
        # agents/guide.yaml
        imports: [libraries/maners.yaml]
        # libraries/manners.yaml
        format: 1
        subtrees: {greet: {tree: {say: Hello.}}}
        """,
        """
        # agents/guide.yaml
        imports: [libraries/manners.yaml]
        # libraries/manners.yaml
        format: 1
        subtrees: {greet: {tree: {say: Hello.}}}
        """,
        FileKind.FOLDER,
    ),
    error(
        "not-a-file",
        "A folder, pipe, socket or device stands where a file is expected.",
        """
        # agents/guide.yaml/
        """,
        """
        # agents/guide.yaml
        tree: {say: Hello.}
        """,
        FileKind.FOLDER,
    ),
    error(
        "too-large",
        "The file is larger than 1 MiB.",
        """
        tree: {say: Hello.}
        # ⟨x × 1,048,577⟩
        """,
        """
        tree: {say: Hello.}
        """,
    ),
    error(
        "not-utf8",
        "The file is not saved as UTF-8 text.",
        """
        tree: {say: Gr⟨byte FC⟩ezi.}
        """,
        """
        tree: {say: Grüezi.}
        """,
    ),
    error(
        "bad-character",
        "The file holds an invisible character that no script needs.",
        """
        tree: {say: "Hello⟨U+202E⟩."}
        """,
        """
        tree: {say: "Hello."}
        """,
    ),
    error(
        "syntax",
        "The line is not valid YAML.",
        """
        tree:
          say: Two things: your bag and your hat.
        """,
        """
        tree:
          say: "Two things: your bag and your hat."
        """,
    ),
    error(
        "tab",
        "A tab is used to indent; YAML indents with spaces.",
        """
        tree:
        ⟨tab⟩say: Hello.
        """,
        """
        tree:
          say: Hello.
        """,
    ),
    error(
        "too-deep",
        "Lists and mappings are nested more than 64 deep.",
        """
        tags: ⟨[ × 65⟩⟨] × 65⟩
        """,
        """
        tags: []
        """,
    ),
    error(
        "too-many-values",
        "The file holds more than 50,000 values.",
        """
        tags: [⟨a, × 50,001⟩]
        """,
        """
        tags: [a]
        """,
    ),
    error(
        "anchor",
        "Anchors (&name) and aliases (*name) are not part of this language.",
        """
        tree:
          sequence:
            - &hello {say: Hello.}
            - *hello
        """,
        """
        tree:
          sequence:
            - say: Hello.
            - say: Hello.
        """,
    ),
    error(
        "too-long",
        "One text has more than 20,000 characters.",
        """
        description: ⟨word × 5,001⟩
        """,
        """
        description: a few words
        """,
    ),
    error(
        "tag",
        "Tags (!name) are not part of this language.",
        """
        tree: {say: !loud Hello.}
        """,
        """
        tree: {say: "!loud Hello."}
        """,
    ),
    error(
        "merge-key",
        "The merge key (<<) is not part of this language.",
        """
        profile:
          <<: {age: 3}
          familiarity: 3
          mood: 3
        """,
        """
        profile:
          age: 3
          familiarity: 3
          mood: 3
        """,
    ),
    error(
        "several-documents",
        "A second document starts in the file (---).",
        """
        tree: {say: Hello.}
        ---
        tree: {say: Goodbye.}
        """,
        """
        tree:
          sequence:
            - say: Hello.
            - say: Goodbye.
        """,
    ),
    error(
        "empty-file",
        "Nothing is written in the file.",
        """
        # agents/guide.yaml
        """,
        """
        # agents/guide.yaml
        tree: {say: Hello.}
        """,
        FileKind.FOLDER,
    ),
    error(
        "bad-key",
        "A key is empty, a list or a mapping instead of a word.",
        """
        profile: {[age, mood]: 3, familiarity: 3}
        """,
        """
        profile: {age: 3, mood: 3, familiarity: 3}
        """,
    ),
    error(
        "duplicate-key",
        "The same key stands twice in one mapping, or the same import twice in one list.",
        """
        tree:
          say: Hello.
          say: Welcome.
        """,
        """
        tree:
          sequence:
            - say: Hello.
            - say: Welcome.
        """,
    ),
)
"""In the order in which a file is read."""
