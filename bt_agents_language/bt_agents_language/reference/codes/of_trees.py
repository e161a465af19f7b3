# SPDX-License-Identifier: Apache-2.0
"""Codes for trees, skills and everything that one file says about another one."""

from __future__ import annotations

from bt_agents_language.reference.codes.entry import FileKind, error

TREE_CODES = (
    error(
        "not-a-node",
        "A node is expected, something else was found.",
        """
        tree:
          sequence:
            - say Hello.
        """,
        """
        tree:
          sequence:
            - say: Hello.
        """,
    ),
    error(
        "no-node",
        "There are decorators but no node that they decorate.",
        """
        tree:
          sequence:
            - say: Hello.
            - timeout: 5 s
        """,
        """
        tree:
          sequence:
            - say: Hello.
              timeout: 5 s
        """,
    ),
    error(
        "two-nodes",
        "Two nodes stand in one item.",
        """
        tree:
          sequence:
            - say: Hello.
              wait: 2 s
        """,
        """
        tree:
          sequence:
            - say: Hello.
            - wait: 2 s
        """,
    ),
    error(
        "unknown-node",
        "No node, skill or decorator has this name.",
        """
        tree:
          sya: Hello.
        """,
        """
        tree:
          say: Hello.
        """,
    ),
    error(
        "no-children",
        "A composite has no children.",
        """
        tree:
          sequence: []
        """,
        """
        tree:
          sequence:
            - say: Hello.
        """,
    ),
    error(
        "misplaced-key",
        "A key stands where it has nothing to act on.",
        """
        tree:
          sequence:
            - say: Hello.
              weight: 2
        """,
        """
        tree:
          random:
            - say: Hello.
              weight: 2
            - say: Welcome.
        """,
    ),
    error(
        "unknown-subtree",
        "Neither the file nor its imports have a subtree of this name.",
        """
        tree: {subtree: gret}
        subtrees:
          greet: {tree: {say: Hello.}}
        """,
        """
        tree: {subtree: greet}
        subtrees:
          greet: {tree: {say: Hello.}}
        """,
    ),
    error(
        "unwritten-output",
        "A subtree declares an output that none of its nodes gives a value.",
        """
        tree: {subtree: find_out}
        subtrees:
          find_out:
            outputs: {place: text}
            tree: {ask: Where to?}
        """,
        """
        tree: {subtree: find_out}
        subtrees:
          find_out:
            outputs: {place: text}
            tree: {ask: Where to?, outputs: {place: answer}}
        """,
    ),
    error(
        "recursion",
        "A subtree contains itself.",
        """
        tree: {subtree: greet}
        subtrees:
          greet:
            tree: {sequence: [{say: Hello.}, {subtree: greet}]}
        """,
        """
        tree: {subtree: greet, repeat: 2}
        subtrees:
          greet:
            tree: {say: Hello.}
        """,
    ),
    error(
        "tree-too-large",
        "A tree has more than 10,000 nodes, or is nested more than 64 deep.",
        """
        tree:
          sequence: [⟨{wait: 1 s}, × 10,000⟩]
        """,
        """
        tree:
          wait: 1 s
          repeat: 10000
        """,
    ),
    error(
        "bad-binding",
        "A skill is not bound to exactly one action, service or topic.",
        """
        format: 1
        skills:
          chime:
            service: {name: chime, type: std_srvs/srv/Trigger}
            topic: {name: chime, type: std_msgs/msg/String, message: {data: chime}}
        """,
        """
        format: 1
        skills:
          chime:
            service: {name: chime, type: std_srvs/srv/Trigger}
        """,
        FileKind.SKILLS,
    ),
    error(
        "duplicate-skill",
        "Another file, or the same one, has a skill of the same name.",
        """
        # skills/display.yaml
        format: 1
        skills:
          say: {topic: {name: text, type: std_msgs/msg/String, message: {data: Hello.}}}
        """,
        """
        # skills/display.yaml
        format: 1
        bindings:
          say: {topic: {name: text, type: std_msgs/msg/String, message: {data: "${text}"}}}
        """,
        FileKind.FOLDER,
    ),
    error(
        "duplicate-agent",
        "Another file has an agent of the same name.",
        """
        # agents/guide.yaml
        agent: guide
        # agents/guide_copy.yaml
        agent: guide
        """,
        """
        # agents/guide.yaml
        agent: guide
        # agents/guide_copy.yaml
        agent: patient_guide
        """,
        FileKind.FOLDER,
    ),
    error(
        "no-agents",
        "A trees folder has no agent.",
        """
        # scripts/morning.yaml
        format: 1
        visits: [{label: somebody}]
        """,
        """
        # agents/guide.yaml
        tree: {say: Hello.}
        """,
        FileKind.FOLDER,
    ),
    error(
        "bad-import",
        "An import is not the path of a YAML file inside of the trees folder.",
        """
        # agents/guide.yaml
        imports: [../libraries/manners.yaml]
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
        "broken-import",
        "A file that is imported has errors itself.",
        """
        # agents/guide.yaml
        imports: [libraries/manners.yaml]
        # libraries/manners.yaml
        format: 1
        subtrees: {greet: {tree: {sya: Hello.}}}
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
        "import-cycle",
        "A file imports a file that imports it.",
        """
        # libraries/greetings.yaml
        format: 1
        imports: [libraries/greetings.yaml]
        subtrees: {greet: {tree: {say: Hello.}}}
        """,
        """
        # libraries/greetings.yaml
        format: 1
        subtrees: {greet: {tree: {say: Hello.}}}
        """,
        FileKind.FOLDER,
    ),
    error(
        "unknown-agent",
        "No agent that can be read has this name.",
        """
        test: gide
        cases:
          - name: it greets
            expect: {ends: succeeded}
        """,
        """
        test: guide
        cases:
          - name: it greets
            expect: {ends: succeeded}
        """,
        FileKind.TEST,
    ),
    error(
        "unknown-path",
        "No node of the agent's trees has this path.",
        """
        test: guide
        cases:
          - name: it greets
            expect: {visited: tree/7.say}
        """,
        """
        test: guide
        cases:
          - name: it greets
            expect: {visited: tree}
        """,
        FileKind.TEST,
    ),
    error(
        "contradiction",
        "Two keys say different things about the same.",
        """
        tree:
          drive: gate 4
          succeed: true
          fail: true
        """,
        """
        tree:
          drive: gate 4
          succeed: true
        """,
    ),
)
"""Nodes first, then skills, then what spans several files."""
