# SPDX-License-Identifier: Apache-2.0
"""Layers of profiles: for one person or one place, on top of the one for everybody."""

from __future__ import annotations

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene

EVERYBODY = ""
"""The layer that always exists."""

PERSON = "person"
PLACE = "place"

MOST_LAYERS = 1000
"""Maximum number of persons and places with own profiles for one agent."""

LONGEST_LAYER = 256


def layers_of(scene: Scene) -> dict[str, str]:
    """Return the layers of a scene by kind, in order of precedence."""
    named = {PERSON: scene.person_id, PLACE: scene.place}
    return {kind: f"{kind}/{name}" for kind, name in named.items() if name}


def checked_layer(layer: str) -> str:
    """Return the name of a layer for a person or a place, or refuse it with ``BAD_LAYER``."""
    kind, slash, name = layer.partition("/")
    if not layer.isprintable():
        raise Refused(
            RefusalCode.BAD_LAYER,
            f"{layer[:80]!a} is not a layer, expected no control characters in a name",
        )
    if kind not in (PERSON, PLACE) or not slash or not name or len(layer) > LONGEST_LAYER:
        raise Refused(
            RefusalCode.BAD_LAYER,
            f"'{layer[:80]}' is not a layer, expected person/ or place/ and a name, such as "
            "person/anna",
        )
    return layer
