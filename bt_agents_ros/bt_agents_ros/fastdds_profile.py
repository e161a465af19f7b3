# SPDX-License-Identifier: Apache-2.0
"""Profiles of Fast DDS: XML files that define how processes of a system reach each other."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from bt_agents_core.errors import BtAgentsError

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable with the file of the profile."""

NAMESPACE = "http://www.eprosima.com"

_SECOND_NS = 10**9


class FastDdsProfile:
    """Profile derived from another one.

    Args:
        file: The other profile; empty for the defaults of Fast DDS.

    Raises:
        BtAgentsError: The file cannot be read, or is not XML.
    """

    def __init__(self, file: str) -> None:
        ElementTree.register_namespace("", NAMESPACE)
        try:
            self._root = (
                ElementTree.parse(file).getroot()
                if file
                else ElementTree.Element(f"{{{NAMESPACE}}}dds")
            )
        except (OSError, ElementTree.ParseError) as error:
            raise BtAgentsError(f"{PROFILE} is '{file}', which cannot be read: {error}") from None
        # Fast DDS also reads a file whose elements have no namespace.
        self._prefix = self._root.tag[: self._root.tag.rfind("}") + 1]

    def set_property(self, name: str, value: str) -> None:
        """Set a property of all default participants."""
        for participant in self._default_participants():
            policy = self._child(self._child(participant, "rtps"), "propertiesPolicy")
            entry = self._added(self._child(policy, "properties"), "property")
            self._added(entry, "name").text = name
            self._added(entry, "value").text = value

    def prolong_lifespans(self, factor: float) -> None:
        """Multiply the lifespan of messages by a factor; infinite lifespans stay."""
        for duration in self._root.iterfind(f".//{self._prefix}lifespan/{self._prefix}duration"):
            seconds, nanoseconds = self._number(duration, "sec"), self._number(duration, "nanosec")
            if seconds is None or nanoseconds is None:
                continue
            longer = round(factor * (seconds * _SECOND_NS + nanoseconds))
            self._child(duration, "sec").text = str(longer // _SECOND_NS)
            self._child(duration, "nanosec").text = str(longer % _SECOND_NS)

    def text(self) -> str:
        """Return the XML document."""
        body = ElementTree.tostring(self._root, encoding="unicode")
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'

    def _default_participants(self) -> list[ElementTree.Element]:
        is_whole = not self._root.tag.endswith("profiles")
        profiles = self._child(self._root, "profiles") if is_whole else self._root
        found = profiles.findall(f"{self._prefix}participant")
        default = [one for one in found if one.get("is_default_profile") == "true"]
        if not default:
            made = self._added(profiles, "participant")
            made.set("profile_name", "bt_agents")
            made.set("is_default_profile", "true")
            default = [made]
        return default

    def _number(self, duration: ElementTree.Element, name: str) -> int | None:
        """Return a part of a duration, 0 if missing; None if it is not a number but infinite."""
        text = duration.findtext(f"{self._prefix}{name}", "0").strip()
        return int(text) if text.isdecimal() else None

    def _child(self, parent: ElementTree.Element, name: str) -> ElementTree.Element:
        found = parent.find(f"{self._prefix}{name}")
        return self._added(parent, name) if found is None else found

    def _added(self, parent: ElementTree.Element, name: str) -> ElementTree.Element:
        return ElementTree.SubElement(parent, f"{self._prefix}{name}")
