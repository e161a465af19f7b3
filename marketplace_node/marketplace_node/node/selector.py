# SPDX-License-Identifier: Apache-2.0
"""Selector node: a language model ranks bids for the strategy ``external``."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from concurrent.futures import Future as ThreadFuture
from functools import partial
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_core.trees_folder import find_trees
from bt_agents_interfaces.msg import HostCard
from bt_agents_interfaces.srv import SelectAgent
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.messages import scene_from_msg
from bt_agents_ros.parameters import TREES, StartParameter, make_from_parameters
from bt_agents_ros.spinner import run
from bt_agents_ros.timers import steady_timer
from marketplace_node.external_ranking.http_client import HttpClient
from marketplace_node.external_ranking.openai_protocol import (
    MOST_BYTES,
    Bidder,
    Endpoint,
    answer,
    question,
)
from marketplace_node.hosts.registry import MOST_HOSTS
from marketplace_node.round.decision import External

BASE_URL = StartParameter(
    name="base_url", description="address of the server, such as http://127.0.0.1:11434/v1"
)
MODEL = StartParameter(name="model", description="name of the model on the server")
KEY_VARIABLE = StartParameter(
    name="key_variable",
    description="environment variable that holds the key of the server; empty for no key",
)

_POLL_S = 0.01
_LONGEST_S = 60.0
_SHARE = 0.95  # share of the limit for the server; the rest is for reporting a missing answer
_MOST_WAITING = 4
"""Most requests in progress at the server; a further one is refused at once."""


class SelectorNode(BaseNode):
    """Service ``bt_agents/select``; asks a server that speaks the chat-completions protocol.

    Attributes:
        descriptions: Descriptions of the agents, by host and agent.
    """

    def __init__(self, space: SceneSpace, endpoint: Endpoint, **node_kwargs: Any) -> None:
        super().__init__("selector", **node_kwargs)
        self._space = space
        self._endpoint = endpoint
        self.descriptions: dict[str, dict[str, str]] = {}
        self._requests: list[tuple[ThreadFuture[External], Future]] = []
        self._client = HttpClient("selector")
        self._poll = steady_timer(self, _POLL_S, self._take_answers, running=False)
        self.create_subscription(HostCard, "bt_agents/cards", self._take_card, qos.FACTS)
        self.create_service(
            SelectAgent,
            "bt_agents/select",
            self._select,
            qos_profile=qos.SERVICE,
            # In a mutually exclusive group, a waiting request would block the other callbacks.
            callback_group=ReentrantCallbackGroup(),
        )
        self.get_logger().info(f"{endpoint.url} is asked for rankings ({endpoint.model})")

    def destroy_node(self) -> None:
        """Destroy the node without waiting for requests in progress."""
        self._client.close()
        super().destroy_node()

    def _take_card(self, card: HostCard) -> None:
        self.descriptions.pop(card.host, None)
        while len(self.descriptions) >= MOST_HOSTS:
            del self.descriptions[next(iter(self.descriptions))]
        self.descriptions[card.host] = {
            agent.name: ". ".join(part for part in (agent.title, agent.description) if part)
            for agent in card.agents
        }

    async def _select(
        self, request: SelectAgent.Request, response: SelectAgent.Response
    ) -> SelectAgent.Response:
        try:
            found = await self._ask(request)
        except Refused as refused:
            self.get_logger().warning(f"round {request.round}: {refused}")
            response.message = refused.reason
            return response
        response.accepted = True
        response.ranking = list(found.ranking)
        response.message = found.message
        return response

    async def _ask(self, request: SelectAgent.Request) -> External:
        """Ask the server for a ranking.

        Raises:
            Refused: The server cannot be asked, or its answer cannot be used.
        """
        bidders = self._bidders(request)
        scene = scene_from_msg(request.scene, self._space)
        if len(self._requests) >= _MOST_WAITING:
            raise Refused(
                RefusalCode.BUSY, f"{len(self._requests)} questions wait for the server already"
            )
        limit_s = request.limit_s
        if not 0.0 < limit_s <= _LONGEST_S:
            raise Refused(
                RefusalCode.OUT_OF_RANGE,
                f"limit_s is {limit_s:g}, expected more than 0 to {_LONGEST_S:g} s",
            )
        body = json.dumps(question(self._endpoint.model, self._space, scene, bidders)).encode()
        names = [bidder.name for bidder in bidders]
        request_future = self._client.post(
            self._endpoint.url,
            self._endpoint.headers(),
            body,
            partial(answer, bidders=names),
            limit_s=_SHARE * limit_s,
            most=MOST_BYTES,
        )
        ended = Future()
        self._requests.append((request_future, ended))
        if self._poll.is_canceled():
            self._poll.reset()
        await ended
        try:
            return request_future.result(timeout=0)
        except Refused:
            raise
        except Exception as error:
            raise Refused(RefusalCode.FAILED, f"asking failed: {type(error).__name__}") from None

    def _bidders(self, request: SelectAgent.Request) -> list[Bidder]:
        space, count = self._space.profiles, len(request.agents)
        width = len(space)
        if len(request.vectors) != count * width or len(request.distances) != count:
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{count} agents with {len(request.vectors)} values and "
                f"{len(request.distances)} distances, expected {count * width} and {count}",
            )
        if not all(math.isfinite(distance) for distance in request.distances):
            raise Refused(RefusalCode.NOT_FINITE, "a distance is not a finite number")
        described = {
            n: text for by_agent in self.descriptions.values() for n, text in by_agent.items()
        }
        return [
            Bidder(
                name=name,
                vector=space.vector(
                    request.vectors[index * width : (index + 1) * width], what=f"bid of {name}"
                ),
                distance=request.distances[index],
                description=described.get(name, ""),
            )
            for index, name in enumerate(request.agents)
        ]

    def _take_answers(self) -> None:
        """Resume the requests whose server has answered: threads must not call into rclpy."""
        ended = [one for one in self._requests if one[0].done()]
        self._requests = [one for one in self._requests if not one[0].done()]
        if not self._requests:
            self._poll.cancel()
        for _, waiting in ended:
            waiting.set_result(None)


def make_node() -> SelectorNode:
    """Create the node from the parameters of its process.

    Raises:
        BtAgentsError: The trees folder cannot be used, or there is no key.
    """

    def make(values: Any) -> SelectorNode:
        space = read_scene(find_trees(values["trees"]) / "scene.yaml").space
        variable = values["key_variable"]
        key = os.environ.get(variable, "") if variable else ""
        if variable and not key:
            raise Refused(
                RefusalCode.NO_KEY, f"the environment variable {variable} is not set or empty"
            )
        return SelectorNode(
            space, Endpoint(base_url=values["base_url"], model=values["model"], key=key)
        )

    return make_from_parameters("selector", (TREES, BASE_URL, MODEL, KEY_VARIABLE), make)


def main(args: Sequence[str] | None = None) -> int:
    """Run the selector until it is stopped; return the exit code."""
    return run(make_node, args)
