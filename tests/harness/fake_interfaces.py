# SPDX-License-Identifier: Apache-2.0
"""ROS types without ROS: every type of one package, with one field of any kind."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import BindingKind, FieldType, Plain


class FakeInterfaces:
    """Knows all types of ``known_msgs``; each section of a type has the field ``good``."""

    def has_package(self, package: str) -> bool:
        """Return whether a package is installed."""
        return package != "absent_msgs"

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        """Return why a type cannot be used."""
        return None if type_name.startswith("known_msgs/") else f"no ROS type '{type_name}'"

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field."""
        good = all(part == "good" or not part.isidentifier() for part in path.split("."))
        return None if good else f"no field '{path}' in the {section}"

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        """Return the type of a field's value."""
        return FieldType.ANY

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        """Return why values do not fit; only 'wrong' does not."""
        return "a wrong value" if "wrong" in str(values) else None
