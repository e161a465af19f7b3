# SPDX-License-Identifier: Apache-2.0
"""Limits of messages: the one table of how large a message and each of its fields may be.

The widest system that they are made for has 10,000 agents in a host, scenes of 64 parameters and
trees of 10,000 nodes.
"""

from __future__ import annotations

from collections.abc import Mapping

KIB = 1024
MIB = 1024 * KIB

TOO_LARGE = "TOO_LARGE"
"""Code of a message, or of a request, that is larger than it may be."""

MESSAGE_BYTES = 256 * KIB
"""Bytes of a serialized message of ``bt_agents_interfaces``.

rclpy takes a request as an object only; what counts there are all its characters and entries.
"""

BYTES_OF: Mapping[str, int] = {
    "AgentFiles": 64 * MIB,
    "Auction": 64 * MIB,
    "Bids": 16 * MIB,
    "CallForBids": MIB,
    "HostCard": 64 * MIB,
    "ManageProfiles_Request": 5 * MIB,
    "MarketStatus": 4 * MIB,
    "MoodTrace": 4 * MIB,
    "OpenGoals": MIB,
    "Persons": 4 * MIB,
    "Profiles": 64 * MIB,
    "RegisterHost_Request": 8 * MIB,
    "RunRecord": MIB,
    "SelectAgent_Request": 64 * MIB,
    "TreeStatus": 8 * MIB,
    "Trees": 64 * MIB,
    "Tune_Request": 16 * MIB,
    "Tunables": 64 * MIB,
    "Tunings": 32 * MIB,
}
"""The same of messages that grow with agents, trees or files, instead of :data:`MESSAGE_BYTES`."""

FOREIGN_BYTES = 4 * MIB
"""Bytes of a serialized message of another package, such as a reading of a sensor."""

TEXT_CHARACTERS = 20_000
"""Characters of a text in a field; an author may write as many."""

LIST_ENTRIES = 20_000
"""Entries of a list in a field."""

CHARACTERS_OF: Mapping[str, int] = {
    "AgentFiles.texts": MIB,
    "Analyze_Request.label": 1_000,
    "Auction.explanation": MIB,
    "Auction.reason": MIB,
    "ManageProfiles_Request.document": 4_000_000,
    "MarketStatus.message": MIB,
    "RegisterHost_Request.host_instance": 200,
    "RunRecord.record": 200_000,
}
"""Characters of a text in a field, instead of :data:`TEXT_CHARACTERS`."""

ENTRIES_OF: Mapping[str, int] = {
    "Bids.vectors": 1_000_000,
    "Bids.weights": 1_000_000,
    "Profiles.agents": 200_000,
    "Profiles.layers": 200_000,
    "Profiles.revisions": 200_000,
    "Profiles.vectors": 2_000_000,
    "SelectAgent_Request.vectors": 1_000_000,
    "Tunables.tunables": 200_000,
}
"""Entries of a list in a field, instead of :data:`LIST_ENTRIES`."""

SCENE_CHARACTERS: Mapping[str, int] = {
    "scene_id": 200,
    "label": 1_000,
    "person_id": 200,
    "place": 200,
}
"""Characters of the texts of a scene; who announces a longer one is answered by name."""
