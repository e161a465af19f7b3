# SPDX-License-Identifier: Apache-2.0
"""Codes for keys, values and names: one piece of a file that is not what it should be."""

from __future__ import annotations

from bt_agents_language.reference.codes.entry import FileKind, error

VALUE_CODES = (
    error(
        "missing-key",
        "A key that is needed is not there.",
        """
        feedback:
          - when: mood.change <= -1
        """,
        """
        feedback:
          - when: mood.change <= -1
            give: negative
        """,
    ),
    error(
        "unknown-key",
        "Nothing reads a key of this name here.",
        """
        tree:
          say: {text: Hello., spead: 0.9}
        """,
        """
        tree:
          say: {text: Hello., rate: 0.9}
        """,
    ),
    error(
        "missing-value",
        "A key has nothing behind its colon.",
        """
        tree:
          say:
        """,
        """
        tree:
          say: Hello.
        """,
    ),
    error(
        "wrong-type",
        "One kind of value is expected, another was found.",
        """
        tree:
          sequence: {say: Hello.}
        """,
        """
        tree:
          sequence:
            - say: Hello.
        """,
    ),
    error(
        "bad-number",
        "The value is not a finite number in plain writing.",
        """
        learning_rate: 0,2
        """,
        """
        learning_rate: 0.2
        """,
    ),
    error(
        "bad-duration",
        "The value is not a time with a unit.",
        """
        tree:
          wait: 2 sec.
        """,
        """
        tree:
          wait: 2 s
        """,
    ),
    error(
        "bad-length",
        "The value is not a length with a unit.",
        """
        tree:
          subtree: come_closer
          with: {distance: 2 s}
        subtrees:
          come_closer:
            inputs: {distance: length}
            tree: {log: "come ${distance} closer"}
        """,
        """
        tree:
          subtree: come_closer
          with: {distance: 2 m}
        subtrees:
          come_closer:
            inputs: {distance: length}
            tree: {log: "come ${distance} closer"}
        """,
    ),
    error(
        "bad-angle",
        "The value is not an angle with a unit.",
        """
        tree:
          subtree: turn
          with: {by: 90°}
        subtrees:
          turn:
            inputs: {by: angle}
            tree: {log: "turn by ${by}"}
        """,
        """
        tree:
          subtree: turn
          with: {by: 90 deg}
        subtrees:
          turn:
            inputs: {by: angle}
            tree: {log: "turn by ${by}"}
        """,
    ),
    error(
        "bad-choice",
        "The value is none of the words that are possible here.",
        """
        tree:
          log: {message: Nobody is here., level: warn}
        """,
        """
        tree:
          log: {message: Nobody is here., level: warning}
        """,
    ),
    error(
        "bad-name",
        "A name has other characters than names can have, or is too long.",
        """
        agent: Friendly Guide
        """,
        """
        agent: friendly_guide
        title: Friendly guide
        """,
    ),
    error(
        "out-of-range",
        "A number is smaller or larger than it may be.",
        """
        profile: {age: 7, familiarity: 3, mood: 3}
        """,
        """
        profile: {age: 5, familiarity: 3, mood: 3}
        """,
    ),
    error(
        "off-step",
        "The default of a tunable lies between two of its steps.",
        """
        tunables:
          rate: {default: 0.93, min: 0.5, max: 1.5, step: 0.05}
        tree: {say: {text: Hello., rate: "${rate}"}}
        """,
        """
        tunables:
          rate: {default: 0.95, min: 0.5, max: 1.5, step: 0.05}
        tree: {say: {text: Hello., rate: "${rate}"}}
        """,
    ),
    error(
        "wrong-format",
        "The file is written for another version of the language.",
        """
        format: 2
        visits:
          - label: somebody
        """,
        """
        format: 1
        visits:
          - label: somebody
        """,
        FileKind.SCRIPT,
    ),
    error(
        "name-taken",
        "Two things have the same name, or one has a reserved name.",
        """
        tunables:
          patience: {default: 8 s, min: 2 s, max: 30 s}
        tree:
          sequence:
            - set: {patience: 5}
            - wait: ${patience}
        """,
        """
        tunables:
          patience: {default: 8 s, min: 2 s, max: 30 s}
        tree:
          sequence:
            - set: {tries: 5}
            - wait: ${patience}
        """,
    ),
    error(
        "bad-reference",
        "A ${…} does not hold a name or an expression.",
        """
        tree:
          say: Hello ${}.
        """,
        """
        tree:
          say: Hello, you are number ${scene.age}.
        """,
    ),
    error(
        "unknown-name",
        "Nothing has this name.",
        """
        tree:
          check: scene.agee >= 4
        """,
        """
        tree:
          check: scene.age >= 4
        """,
    ),
    error(
        "no-value-yet",
        "A name is used before anything can have given it a value.",
        """
        tree:
          sequence:
            - say: You said ${answer}.
            - ask: Where to?
        """,
        """
        tree:
          sequence:
            - ask: Where to?
            - say: You said ${answer}.
        """,
    ),
    error(
        "wrong-value",
        "A name's value has another type than the place where it is used.",
        """
        tree:
          sequence:
            - ask: How long?
            - wait: ${answer}
        """,
        """
        tunables:
          patience: {default: 8 s, min: 2 s, max: 30 s}
        tree:
          wait: ${patience}
        """,
    ),
    error(
        "bad-expression",
        "A condition is not written as conditions are.",
        """
        tree:
          check: scene.age => 4
        """,
        """
        tree:
          check: scene.age >= 4
        """,
    ),
    error(
        "bad-ros-name",
        "The name of a topic, service or action breaks the rules of ROS.",
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm button, type: std_msgs/msg/Bool}
        """,
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm_button, type: std_msgs/msg/Bool}
        """,
    ),
    error(
        "bad-ros-type",
        "The name of a ROS type is not written package/kind/Name.",
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/Bool}
        """,
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/msg/Bool}
        """,
    ),
    error(
        "unknown-ros-type",
        "No installed ROS package has this type.",
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/msg/Boolean}
        """,
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/msg/Bool}
        """,
    ),
    error(
        "unknown-ros-field",
        "The ROS type has no such field.",
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/msg/Bool, until: msg.value}
        """,
        """
        tree:
          timeout: 30 s
          wait_for: {topic: confirm, type: std_msgs/msg/Bool, until: msg.data}
        """,
    ),
)
"""Shapes and numbers first, then names, then ROS."""
