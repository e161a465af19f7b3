# SPDX-License-Identifier: Apache-2.0
"""ROS types that need no ROS: every type of one package, each with one field."""

from __future__ import annotations

from bt_agents.language.specs import BindingKind


class FakeInterfaces:
    """Knows the types of ``known_msgs``; every section of one has the field ``good``."""

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        """Return why a type cannot be used."""
        return None if type_name.startswith("known_msgs/") else f"no ROS type '{type_name}'"

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field."""
        good = all(part == "good" or part.isdigit() for part in path.split("."))
        return None if good else f"no field '{path}' in the {section}"
