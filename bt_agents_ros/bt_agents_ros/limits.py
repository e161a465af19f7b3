# SPDX-License-Identifier: Apache-2.0
"""Limits of messages: the only table of maximum sizes of messages and their fields.

The largest intended system has 10,000 agents in a host, with 20 nodes, 5 tunables and 1,500
characters each, scenes of 64 parameters and trees of 10,000 nodes; its messages need at most four
fifths of the allowed bytes.
"""

from __future__ import annotations

from collections.abc import Mapping

KIB = 1024
MIB = 1024 * KIB

MESSAGE_BYTES = 256 * KIB
"""Most bytes of a serialized message of ``bt_agents_interfaces``, and of any request."""

BYTES_OF: Mapping[str, int] = {
    "AgentFiles": 32 * MIB,
    "Auction": 48 * MIB,
    "Bids": 16 * MIB,
    "CallForBids": MIB,
    "HostCard": 48 * MIB,
    "ManageProfiles_Request": 5 * MIB,
    "ManageProfiles_Response": 5 * MIB,
    "MarketStatus": 4 * MIB,
    "MoodTrace": 4 * MIB,
    "NodeDetails": MIB,
    "OpenGoals": MIB,
    "Persons": 4 * MIB,
    "Profiles": 32 * MIB,
    "RegisterHost_Request": 8 * MIB,
    "RunControl": MIB,
    "SelectAgent_Request": 12 * MIB,
    "TreeStatus": 8 * MIB,
    "Trees": 48 * MIB,
    "Tune_Request": 16 * MIB,
    "Tunables": 32 * MIB,
    "Tunings": 32 * MIB,
}
"""The same for messages that grow with agents, trees or files."""

FOREIGN_BYTES = 4 * MIB
"""Most bytes of a serialized message of another package, such as a sensor reading or an answer."""

TEXT_CHARACTERS = 20_000
"""Most characters of a text in a field; an author may write as many."""

LIST_ENTRIES = 20_000
"""Most entries of a list in a field."""

FOREIGN_ENTRIES = 5_000
"""Most entries of a list of texts or messages in a message of another package."""

MOST_PARAMETERS = 1_000
"""Most parameters or logger levels in one request; for more, clients send several requests."""

MOST_UNREPORTED = 10
"""Ended runs that a host keeps for the next market and reports when it registers."""

CHARACTERS_OF: Mapping[str, int] = {
    "AgentFiles.texts": MIB,
    "Analyze_Request.label": 1_000,
    "Analyze_Request.request_id": 200,
    "Auction.explanation": MIB,
    "Auction.reason": MIB,
    "ManageProfiles_Request.document": 4_000_000,
    "ManageProfiles_Response.document": 4_000_000,
    "MarketStatus.message": MIB,
    "Record_Request.author": 200,
    "Record_Request.label": 200,
    "Record_Request.notes": 2_000,
    "RegisterHost_Request.host_instance": 200,
    "SceneValue.source": 1_000,
}
"""Most characters of a text in these fields, instead of :data:`TEXT_CHARACTERS`."""

ENTRIES_OF: Mapping[str, int] = {
    "Bids.vectors": 1_000_000,
    "Bids.weights": 1_000_000,
    "DescribeParameters_Request.names": MOST_PARAMETERS,
    "GetLoggerLevels_Request.names": MOST_PARAMETERS,
    "GetParameterTypes_Request.names": MOST_PARAMETERS,
    "GetParameters_Request.names": MOST_PARAMETERS,
    "GoalStatusArray.status_list": 1_000,
    "HostCard.agents": 10_000,
    "ListParameters_Request.prefixes": MOST_PARAMETERS,
    "OpenGoals.goals": 1_000,
    "Profiles.agents": 200_000,
    "Profiles.layers": 200_000,
    "Profiles.revisions": 200_000,
    "Profiles.vectors": 2_000_000,
    "RegisterHost_Request.unreported": MOST_UNREPORTED,
    "Remember_Request.facts": 100,
    "Scene.remembered": 100,
    "Scene.values": 200,
    "SelectAgent_Request.vectors": 1_000_000,
    "SetLoggerLevels_Request.levels": MOST_PARAMETERS,
    "SetParametersAtomically_Request.parameters": MOST_PARAMETERS,
    "SetParameters_Request.parameters": MOST_PARAMETERS,
    "Tunables.tunables": 100_000,
}
"""Most entries of lists in these fields, instead of the two general limits."""

SCENE_CHARACTERS: Mapping[str, int] = {
    "scene_id": 200,
    "label": 1_000,
    "person_id": 200,
    "place": 200,
}
"""Most characters of the texts of a scene; the refusal of a longer one names the field."""
