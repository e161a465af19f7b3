# SPDX-License-Identifier: Apache-2.0
"""States of a managed node, as in rcl's state machine, and the services for them."""

from __future__ import annotations

import traceback
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

from lifecycle_msgs.msg import State, Transition, TransitionDescription, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import ellipsize, printable_line
from bt_agents_ros import qos

_SUCCESS, _FAILURE, _ERROR = "transition_success", "transition_failure", "transition_error"


class Lifecycle:
    """State machine of a managed node, with its five services and ``~/transition_event``.

    rclpy's ``LifecycleNode`` answers when a callback returns; a tree that must end cleanly takes
    as long as it needs, so here transitions can be awaited.

    Args:
        change: Makes the transition with an id, which is possible in the current state.
    """

    def __init__(self, node: Node, change: Callable[[int], Awaitable[None]]) -> None:
        self._node = node
        self._change = change
        group = ReentrantCallbackGroup()
        for kind, name, answer in (
            (ChangeState, "change_state", self._on_change_state),
            (GetState, "get_state", self._on_get_state),
            (GetAvailableStates, "get_available_states", self._on_get_states),
            (GetAvailableTransitions, "get_available_transitions", self._on_get_transitions),
            (GetAvailableTransitions, "get_transition_graph", self._on_get_graph),
        ):
            node.create_service(
                kind, f"~/{name}", answer, qos_profile=qos.SERVICE, callback_group=group
            )
        self._events = node.create_publisher(TransitionEvent, "~/transition_event", qos.EVENTS)
        with node.handle:
            self._machine = rclpy_implementation.LifecycleStateMachine(node.handle, False)

    @property
    def state(self) -> str:
        """Label of the present state, such as ``inactive``."""
        return str(self._machine.current_state[1])

    @property
    def _possible(self) -> dict[int, str]:
        """Labels of the transitions that can be requested now, by their ids.

        During a transition there are none: those that rcl has then report how it ended.
        """
        if self._machine.current_state[0] > State.PRIMARY_STATE_FINALIZED:
            return {}
        return {int(number): label for number, label, *_ in self._machine.available_transitions}

    @contextmanager
    def transition(self, number: int) -> Iterator[None]:
        """Make a transition within this block; its target state is reached after the block.

        After a :class:`BtAgentsError` the node is in its previous state; after any other error it
        is unconfigured, as in rcl.

        Raises:
            Refused: ``NO_TRANSITION``: it does not start from the current state.
        """
        if number not in self._possible:
            raise self._refusal(f"transition {number}")
        self._trigger(self._possible[number])
        try:
            yield
        except BtAgentsError:
            self._trigger(_FAILURE)
            raise
        except Exception:
            self._trigger(_ERROR)
            self._trigger(_SUCCESS)
            raise
        self._trigger(_SUCCESS)

    def destroy(self) -> None:
        """Free the state machine."""
        self._machine.destroy_when_not_in_use()

    def _trigger(self, label: str) -> None:
        start = State(id=self._machine.current_state[0], label=self.state)
        number = self._machine.get_transition_by_label(label)
        self._machine.trigger_transition_by_label(label, False)
        self._events.publish(
            TransitionEvent(
                timestamp=self._node.get_clock().now().nanoseconds,
                transition=Transition(id=number, label=label),
                start_state=start,
                goal_state=State(id=self._machine.current_state[0], label=self.state),
            )
        )

    async def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        before, log = self.state, self._node.get_logger()
        try:
            await self._change(self._number_of(request.transition))
        except BtAgentsError as error:
            log.error(f"it is {self.state}, as before: {error}")
            return response
        except Exception:
            # The caller waits for an answer.
            log.error(f"it was {before} and is {self.state}:\n{traceback.format_exc()}")
            return response
        log.info(f"it was {before} and is {self.state}")
        response.success = True
        return response

    def _number_of(self, transition: Transition) -> int:
        """Return the id of the requested transition, which is given by its label or its id."""
        if not transition.label:
            return int(transition.id)
        for number, label in self._possible.items():
            if label == transition.label:
                return number
        raise self._refusal(f"'{ellipsize(printable_line(transition.label))}'")

    def _refusal(self, what: str) -> Refused:
        names = ", ".join(f"'{label}' ({number})" for number, label in self._possible.items())
        return Refused(
            RefusalCode.NO_TRANSITION,
            f"{what} does not begin in the state '{self.state}', expected {names or 'none'}",
        )

    def _on_get_state(self, _request: Any, response: GetState.Response) -> GetState.Response:
        number, label = self._machine.current_state
        response.current_state = State(id=number, label=label)
        return response

    def _on_get_states(self, _request: Any, response: Any) -> Any:
        response.available_states = [
            State(id=number, label=label) for number, label in self._machine.available_states
        ]
        return response

    def _on_get_transitions(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._machine.available_transitions)
        return response

    def _on_get_graph(self, _request: Any, response: Any) -> Any:
        response.available_transitions = _described(self._machine.transition_graph)
        return response


def _described(transitions: Any) -> list[TransitionDescription]:
    return [
        TransitionDescription(
            transition=Transition(id=number, label=label),
            start_state=State(id=start, label=start_label),
            goal_state=State(id=goal, label=goal_label),
        )
        for number, label, start, start_label, goal, goal_label in transitions
    ]
