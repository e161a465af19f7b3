# SPDX-License-Identifier: Apache-2.0
"""Behaviours that subscribe to a topic in ``setup``."""

from __future__ import annotations

import operator
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Access, ClearingPolicy, Status


class Handler(Behaviour):
    """Keeps the last message of a topic, also when it starts again."""

    def __init__(
        self,
        name: str,
        topic_name: str,
        topic_type: Any,
        qos_profile: Any,
        clearing_policy: ClearingPolicy,
    ) -> None:
        super().__init__(name)
        assert clearing_policy is ClearingPolicy.NEVER
        self.topic = (topic_type, topic_name, qos_profile)
        self.message: Any = None

    def setup(self, **kwargs: Any) -> None:
        message_type, name, qos_profile = self.topic
        self.subscriber = kwargs["node"].create_subscription(
            msg_type=message_type, topic=name, callback=self._take, qos_profile=qos_profile
        )

    def _take(self, message: Any) -> None:
        self.message = message


class CheckData(Handler):
    """Runs until a field of the message has the expected value."""

    def __init__(
        self, name: str, *, variable_name: str, expected_value: Any, **subscribed: Any
    ) -> None:
        super().__init__(name, **subscribed)
        self.field = operator.attrgetter(variable_name)
        self.expected_value = expected_value

    def update(self) -> Status:
        if self.message is None or self.field(self.message) != self.expected_value:
            return Status.RUNNING
        return Status.SUCCESS


class ToBlackboard(Handler):
    """Writes fields of the message, or the message, to the blackboard."""

    def __init__(
        self, name: str, *, blackboard_variables: dict[str, str | None], **subscribed: Any
    ) -> None:
        super().__init__(name, **subscribed)
        self.variables = blackboard_variables
        self.blackboard = self.attach_blackboard_client(name=name)
        for key in blackboard_variables:
            self.blackboard.register_key(key=key, access=Access.WRITE)

    def update(self) -> Status:
        if self.message is None:
            return Status.RUNNING
        for key, field in self.variables.items():
            value = self.message if field is None else operator.attrgetter(field)(self.message)
            self.blackboard.set(key, value)
        return Status.SUCCESS
