# SPDX-License-Identifier: Apache-2.0
"""Codes of warnings: what is legal, but rarely what the author wants to happen on a robot."""

from __future__ import annotations

from bt_agents_language.reference.codes.entry import FileKind, warning

DANGER_CODES = (
    warning(
        "endless-speech",
        "The robot may say the same thing again and again without end.",
        """
        tree:
          retry: {attempts: forever, pause: 5 s}
          sequence:
            - say: Please clear the way.
            - drive: gate 4
        """,
        """
        tree:
          retry: {attempts: 3, pause: 5 s}
          sequence:
            - say: Please clear the way.
            - drive: gate 4
        """,
    ),
    warning(
        "endless-wait",
        "A node waits for something that may never come, and nothing ends the wait.",
        """
        tree:
          wait_for: live.mood >= 4
        """,
        """
        tree:
          wait_for: live.mood >= 4
          timeout: 30 s
        """,
    ),
    warning(
        "never-reached",
        "A node can never be done, because of what stands before or beside it.",
        """
        tree:
          selector:
            - log: The way is free.
            - say: Please clear the way.
        """,
        """
        tree:
          selector:
            - check: live.person
            - say: Please clear the way.
        """,
    ),
    warning(
        "busy-repeat",
        "A node is started again at every tick without end, and takes no time itself.",
        """
        tree:
          repeat: {until: live.mood >= 4}
          log: still unhappy
        """,
        """
        tree:
          repeat: {until: live.mood >= 4, pause: 1 s}
          log: still unhappy
        """,
    ),
    warning(
        "two-voices",
        "Two branches of a parallel speak, possibly at the same time.",
        """
        tree:
          parallel:
            - say: Put your bag on the platform.
            - say: Then press the button.
        """,
        """
        tree:
          parallel:
            - say: Put your bag on the platform. Then press the button.
            - show: {clip: first_time}
        """,
    ),
    warning(
        "unread-tunable",
        "Nothing in the trees of the agent uses a tunable, so turning it changes nothing.",
        """
        tunables:
          rate: {default: 0.9, min: 0.5, max: 1.5}
        tree:
          say: Hello.
        """,
        """
        tunables:
          rate: {default: 0.9, min: 0.5, max: 1.5}
        tree:
          say: {text: Hello., rate: "${rate}"}
        """,
    ),
    warning(
        "unused-input",
        "A subtree declares an input that it never uses.",
        """
        tree: {subtree: greet, with: {who: Anna}}
        subtrees:
          greet:
            inputs: {who: text}
            tree: {say: Hello.}
        """,
        """
        tree: {subtree: greet, with: {who: Anna}}
        subtrees:
          greet:
            inputs: {who: text}
            tree: {say: "Hello ${who}."}
        """,
    ),
    warning(
        "unmarked-name",
        "A name stands in a text as $name or {name}, and is said as it is.",
        """
        tree:
          sequence:
            - ask: Where to?
            - say: I take you to {answer}.
        """,
        """
        tree:
          sequence:
            - ask: Where to?
            - say: I take you to ${answer}.
        """,
    ),
    warning(
        "skill-not-offered",
        "No robot offers a skill here, so that an agent which uses it does not bid.",
        """
        # skills/more.yaml
        format: 1
        skills:
          bow: {description: Bow to a person.}
        # agents/guide.yaml
        tree: {bow: }
        """,
        """
        # skills/more.yaml
        format: 1
        skills:
          bow: {description: Bow to a person.}
        bindings:
          bow: {service: {name: bow, type: std_srvs/srv/Trigger}}
        # agents/guide.yaml
        tree: {bow: }
        """,
        FileKind.FOLDER,
    ),
    warning(
        "unknown-agent-in-rule",
        "A rule of market.yaml names an agent that is not in the folder.",
        """
        # market.yaml
        format: 1
        rules:
          - {when: scene.age <= 2, agents: [giude]}
        # agents/guide.yaml
        tree: {say: Hello.}
        """,
        """
        # market.yaml
        format: 1
        rules:
          - {when: scene.age <= 2, agents: [guide]}
        # agents/guide.yaml
        tree: {say: Hello.}
        """,
        FileKind.FOLDER,
    ),
    warning(
        "bad-plugin",
        "A node that an installed package brings cannot be used.",
        """
        [project.entry-points."bt_agents.nodes"]
        sequence = "py_trees.behaviours:Success"
        """,
        """
        [project.entry-points."bt_agents.nodes"]
        succeed_at_once = "py_trees.behaviours:Success"
        """,
        FileKind.PACKAGE,
    ),
    warning(
        "cut-text",
        "A '#' behind a space starts a comment, so that the rest of a text is lost.",
        """
        tree:
          say: Please go to gate #4.
        """,
        """
        tree:
          say: "Please go to gate #4."
        """,
    ),
)
"""The worst first."""
