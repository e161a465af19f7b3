# SPDX-License-Identifier: Apache-2.0
"""Remember: stores values about the present person, if the person's name is known."""

from __future__ import annotations

from py_trees.common import Status

from bt_agents.engine.scene_layer_leaf import SceneLayerLeaf
from bt_agents_core.errors import Refused
from bt_agents_core.person_facts import Fact, fact, message_fields
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_language.expression.expressions import MissingValue
from bt_agents_language.nodes.remember import BINDING


class Remember(SceneLayerLeaf):
    """SUCCESS if the scene layer has stored the values, else FAILURE with the reason."""

    has_side_effects = True
    binding = BINDING

    def begin(self) -> None:
        self._run = None
        types = self.context.scope.space.remembers
        self._facts: dict[str, Fact] = {
            key: fact(key, self.fields.value(key), types.get(key)) for key in self.spec.fields
        }
        try:
            who = self.scope.lookup("person.name")
        except MissingValue:
            raise Refused(
                RefusalCode.NOBODY_KNOWN,
                "nobody who is known by name is there, so nothing can be remembered",
            ) from None
        facts = tuple(message_fields(key, value) for key, value in self._facts.items())
        self.request({"person_id": who, "facts": facts})

    def step(self) -> Status:
        status = self.answered()
        if status is Status.SUCCESS:
            self.tell({f"person.{key}": value for key, value in self._facts.items()})
        return status


BEHAVIOURS = {"remember": Remember}
