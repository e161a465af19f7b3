# SPDX-License-Identifier: Apache-2.0
"""Studio node: passes messages of a running system to the studio, and its requests to services."""

from __future__ import annotations

import os
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from std_msgs.msg import Empty, String

from bt_agents.host.tuning.tune_service import info_from_msg
from bt_agents_core.errors import Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_core.liveness import HEARTBEAT_S
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import is_full_name
from bt_agents_interfaces.msg import HostCard, OpenQuestions, Tunables, Tunings
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.calls import Calls
from bt_agents_ros.limits import KIB, MIB, MOST_PARAMETERS
from bt_agents_ros.node_main import NO_LOG_FILE
from bt_agents_ros.size_check import check_content, largest_bytes
from bt_agents_ros.spinner import Spinner, starting_ros
from bt_agents_ros.system_topics import HOST, SystemTopic, heard_by, service_called, topic_called
from bt_agents_ros.timers import steady_timer
from bt_agents_ros.types import load_type
from bt_agents_ros.workarounds.cached_wait_set import PolledGroup
from bt_agents_studio.records import ListeningRecord
from bt_agents_studio.studio import Studio
from bt_agents_tools.client import market, open_questions, publication, tuning
from bt_agents_tools.client.write_back import ParameterState

MOST_HOSTS = 100
"""Maximum number of hosts to watch."""

SILENT_S = 10.0
"""Silence after which a host makes room for another one if there are too many [s]."""

MOST_HANDED_OVER = 200
"""Maximum number of received messages in line; then the node takes no more."""

MOST_HANDED_OVER_BYTES = 64 * MIB
"""The same in bytes; a message counts with the size limit of its type."""

MOST_WAITING = 20
"""Maximum number of answers and messages that are being published at a time."""

_JOIN_S = 3.0
_ROOM_S = 0.2
_ADVANCE_S = 0.02
_DETAILS = f"{HOST}/details"
_GRAPH_S = 1.0
_HOSTS_S = 2.0
_MOST_ABSENT = 50
"""Maximum number of hosts without a place whose card is kept."""

_LARGEST_ABSENT = 256 * KIB
"""Maximum size of such a host's card [characters and entries]."""

_TOLD_S = 60.0

_DISCOVERY_S = 2.0
"""Longest time until a service is discovered [s]; a user of a page waits for it."""

_TAKEN_S = 3.0
_VALUES_S = 5.0

Wait = Generator[None, None, str]
"""Work in steps with waits between them; returns its result as text."""

Receive = Callable[[str, Any, float, bool], None]
"""Called with type, message, time of sending [s since 1970], and whether it is the live scene."""


@dataclass(eq=False, kw_only=True)
class _Host:
    """A watched host and its entities in this node.

    Attributes:
        heard_at: Steady time of its last heartbeat [s].
        details: Subscriptions that exist only while a page is open.
    """

    card: HostCard
    heard_at: float
    tunables: Tunables | None = None
    subscriptions: list[Subscription[Any]] = field(default_factory=list)
    details: list[Subscription[Any]] = field(default_factory=list)
    clients: dict[str, Client] = field(default_factory=dict)


class StudioNode(BaseNode):
    """Subscriptions to everything that a studio shows, and clients of all services that it uses.

    Args:
        receive: Called with each message.
        beat: Called with the name of a part at each of its heartbeats.
        value: Called with host, name and value of each tunable when it may have changed.
        graph: Called with the topics that trees subscribe to, and whether a journal runs.
        node_kwargs: For :class:`rclpy.node.Node`.
    """

    def __init__(
        self,
        receive: Receive,
        beat: Callable[[str], None],
        value: Callable[[str, str, Any], None],
        graph: Callable[[Mapping[str, ListeningRecord], bool], None],
        **node_kwargs: Any,
    ) -> None:
        super().__init__("studio", **node_kwargs)
        self._receive = receive
        self._beat = beat
        self._value = value
        self._graph = graph
        self._questions: Sequence[Any] = ()
        self._hosts: dict[str, _Host] = {}
        # Cards of hosts without a heartbeat, newest last.
        self._absent: OrderedDict[str, HostCard] = OrderedDict()
        self._fields: dict[str, Mapping[str, str]] = {}
        self._waiting: list[tuple[Wait, Future[str]]] = []
        self._calls = Calls(self)
        self._service_clients: dict[str, Client] = {}
        self._is_watched = False
        for topic in heard_by("studio"):
            if HOST not in topic.name:
                self._subscribe(topic, topic.name)
        self._reading = steady_timer(self, _GRAPH_S, self._read_graph, running=False)
        self._advancing = steady_timer(self, _ADVANCE_S, self._advance, running=False)
        steady_timer(self, _HOSTS_S, self._check_hosts)
        self._person_heartbeat: Publisher[Empty] | None = None
        self._person_timer = steady_timer(self, HEARTBEAT_S, self._beat_for_person, running=False)

    def watch(self, is_watched: bool, is_person_open: bool = False) -> None:
        """Set whether any page, and whether a page Person, is open; thread-safe.

        Without an open page, the node neither asks hosts to trace values nor reads the graph. With
        an open page Person, it publishes a heartbeat, so that a robot knows that it has a screen.
        """
        self.executor.create_task(partial(self._watch, is_watched, is_person_open))

    def _watch(self, is_watched: bool, is_person_open: bool) -> None:
        if not is_person_open:
            self._person_timer.cancel()
        elif self._person_timer.is_canceled():
            self._person_timer.reset()
            self._beat_for_person()
        if is_watched == self._is_watched:
            return
        self._is_watched = is_watched
        if is_watched:
            for host in self._hosts:
                self._subscribe_details(host)
            self._reading.reset()
            self._read_graph()
            return
        self._reading.cancel()
        for one in self._hosts.values():
            self._destroy(one.details)

    def _beat_for_person(self) -> None:
        if self._person_heartbeat is None:
            # Created late: a studio that only watches has no right to publish.
            self._person_heartbeat = self.create_publisher(
                Empty, "studio/person/heartbeat", qos.SENSOR
            )
        self._person_heartbeat.publish(Empty())

    def _subscribe_details(self, host: str) -> None:
        details = self._subscribe(topic_called(_DETAILS), _DETAILS.replace(HOST, host))
        self._hosts[host].details.append(details)

    def _destroy(self, subscriptions: list[Subscription[Any]]) -> None:
        while subscriptions:
            self.destroy_subscription(subscriptions.pop())

    def answer(self, text: str) -> Future[str]:
        """Answer an open question, as ``bt-agents answer`` does; thread-safe.

        The future has the result as text, or raises ``Refused``.
        """
        return self._begin(partial(self._answer, text))

    def publish(self, topic: str, values: Sequence[str]) -> Future[str]:
        """Publish a message that a tree waits for, as ``bt-agents publish`` does; thread-safe.

        The future has the result as text, or raises ``Refused``.
        """
        return self._begin(partial(self._publish, topic, values))

    def preview(self, values: Mapping[str, float], limit_s: float) -> Future[Any]:
        """Ask the market for the winner of a scene; as :meth:`call`.

        Args:
            values: Values of all scene parameters in order; NaN if missing.
            limit_s: Longest wait for the answer [s].
        """
        given = {name: value for name, value in values.items() if value == value}
        scene = market.scene_of(self, list(values), given, scene_id="preview", person=True)
        return self.call("marketplace/preview", {"scene": scene}, limit_s)

    def set_market_parameters(
        self, changes: Mapping[str, str | float], limit_s: float
    ) -> Future[Any]:
        """Set parameters of the market together; as :meth:`call`."""
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in changes.items()
        ]
        service = "marketplace/set_parameters_atomically"
        return self.call(service, {"parameters": parameters}, limit_s)

    def tuned(self) -> Future[Mapping[str, tuple[Path, Sequence[ParameterState]]]]:
        """Return trees folder, parameters and profile values of each host; thread-safe."""
        answer: Future[Mapping[str, tuple[Path, Sequence[ParameterState]]]] = Future()
        self.executor.create_task(partial(self._read_tuned, answer))
        return answer

    def _begin(self, make: Callable[[], Wait]) -> Future[str]:
        done: Future[str] = Future()

        def begin() -> None:
            if len(self._waiting) >= MOST_WAITING:
                reason = f"{MOST_WAITING} messages are being published; try again"
                done.set_exception(Refused(RefusalCode.BUSY, reason))
                return
            self._waiting.append((make(), done))
            self._advancing.reset()
            self._advance()

        self.executor.create_task(begin)
        return done

    def _advance(self) -> None:
        """Advance all waiting work."""
        for one in list(self._waiting):
            wait, done = one
            try:
                next(wait)
                continue
            except StopIteration as ended:
                done.set_result(ended.value)
            except Exception as error:
                # The caller receives the exception.
                done.set_exception(error)
            self._waiting.remove(one)
        if not self._waiting:
            self._advancing.cancel()

    def _answer(self, text: str) -> Wait:
        asked, taken = open_questions.asked_by(self._questions, text)
        yield from self._published("answers", String(data=taken))
        limit_s = time.monotonic() + _TAKEN_S
        while asked in self._questions:
            if time.monotonic() > limit_s:
                raise open_questions.not_taken(text)
            yield
        return f"answered '{taken}' to: {asked.text}"

    def _publish(self, topic: str, values: Sequence[str]) -> Wait:
        message = publication.heard_message(self._heard(), topic, values)
        if not (yield from self._published(topic, message)):
            raise publication.not_taken(topic)
        return f"published on {topic}"

    def _published(self, topic: str, message: Any) -> Generator[None, None, bool]:
        pending = publication.PendingPublication(self, topic, message, time.monotonic())
        try:
            while (reached := pending.poll(time.monotonic())) is None:
                yield
        finally:
            pending.close()
        return reached

    def _heard(self) -> Mapping[str, str]:
        return publication.heard_topics(self, sorted(self._hosts))

    def _read_graph(self) -> None:
        found = {
            topic: ListeningRecord(type=kind, fields=self._fields_of(kind))
            for topic, kind in self._heard().items()
            if not topic.endswith("heartbeat")
        }
        self._graph(found, bool(self.count_publishers("journal/status")))

    def _fields_of(self, kind: str) -> Mapping[str, str]:
        if kind not in self._fields:
            try:
                message = load_type(kind, BindingKind.TOPIC)
                self._fields[kind] = dict(message.get_fields_and_field_types())
            except Refused:
                self._fields[kind] = {}
        return self._fields[kind]

    def _handle_questions(self, message: OpenQuestions, info: Mapping[str, Any]) -> None:
        self._questions = message.questions
        at_s = int(info["source_timestamp"]) * 1e-9
        self._receive("bt_agents_interfaces/msg/OpenQuestions", message, at_s, False)

    def _read_tuned(
        self, answer: Future[Mapping[str, tuple[Path, Sequence[ParameterState]]]]
    ) -> None:
        found: dict[str, tuple[Path, Sequence[ParameterState]]] = {}
        hosts = {
            name: (one.card, one.tunables.tunables)
            for name, one in sorted(self._hosts.items())
            if one.tunables is not None
        }
        if not hosts:
            answer.set_exception(Refused(RefusalCode.NO_HOST, "no host of agents is running"))
            return

        def fail(host: str, reason: str) -> None:
            if not answer.done():
                answer.set_exception(Refused(RefusalCode.NO_ANSWER, f"{host}: {reason}"))

        def read(host: str, values: Sequence[Any]) -> None:
            card, tunables = hosts[host]
            states = (
                ParameterState(
                    parameter=info_from_msg(one), value=parameter_value_to_python(value)
                )
                for one, value in zip(tunables, values, strict=False)
            )
            found[host] = Path(card.trees), [*states, *tuning.profile_states(card)]
            if len(found) == len(hosts) and not answer.done():
                answer.set_result(found)

        for host, (_, tunables) in hosts.items():
            names = [one.name for one in tunables]
            self._get_parameters(host, names, partial(read, host), partial(fail, host))

    def call(self, service: str, fields: Mapping[str, Any], limit_s: float) -> Future[Any]:
        """Call a service; thread-safe. The future has the answer, or raises ``Refused``.

        Args:
            service: Name of the service.
            fields: Fields of the request.
            limit_s: Longest time for discovery and answer [s].
        """
        answer: Future[Any] = Future()
        self.executor.create_task(partial(self._call, answer, service, fields, limit_s))
        return answer

    def _call(
        self, answer: Future[Any], service: str, fields: Mapping[str, Any], limit_s: float
    ) -> None:
        try:
            request = load_type(service_called(service).type).Request(**fields)
        except (AssertionError, AttributeError, OverflowError) as error:
            answer.set_exception(Refused(RefusalCode.BAD_FIELD, str(error)))
            return
        host = service.rpartition("/")[0]
        if host.startswith("/") and host not in self._hosts:
            answer.set_exception(Refused(RefusalCode.UNKNOWN_HOST, f"there is no host {host}"))
            return
        clients = self._hosts[host].clients if host in self._hosts else self._service_clients
        self._calls.call(
            self._client(clients, service),
            request,
            deadline_s=limit_s,
            on_answer=answer.set_result,
            on_failure=lambda reason: answer.set_exception(Refused(RefusalCode.NO_ANSWER, reason)),
            discovery_s=_DISCOVERY_S,
        )

    def _subscribe(self, topic: SystemTopic, name: str) -> Subscription[Any]:
        part, _, last = name.rpartition("/")
        profile = qos.listening(topic)
        kind = load_type(topic.type)
        if last == "heartbeat":
            # The content is irrelevant, so it is not decoded.
            return self.create_subscription(
                *(kind, name, lambda _data: self._handle_beat(part), profile),
                raw=True,
                callback_group=PolledGroup(),
            )
        own: dict[str, Callable[..., None]] = {
            "cards": self._handle_card,
            "open_questions": self._handle_questions,
            "tunables": partial(self._handle_tuning, part),
            "tunings": partial(self._handle_tuning, part),
        }
        live = topic.name == "bt_agents/scene/live"

        def handle(message: Any, info: Mapping[str, Any]) -> None:
            self._receive(topic.type, message, int(info["source_timestamp"]) * 1e-9, live)

        return self.create_subscription(kind, name, own.get(last, handle), profile)

    def _handle_card(self, message: HostCard, info: Mapping[str, Any]) -> None:
        host = message.host
        if not is_full_name(host):
            return
        at_s = int(info["source_timestamp"]) * 1e-9
        self._receive("bt_agents_interfaces/msg/HostCard", message, at_s, False)
        if host in self._hosts:
            self._hosts[host].card = message
            return
        if not self._admit(host, message):
            self._put_aside(host, message)

    def _handle_beat(self, part: str) -> None:
        if part in self._hosts:
            self._hosts[part].heard_at = time.monotonic()
        self._beat(part)

    def _put_aside(self, host: str, card: HostCard) -> None:
        """Keep the card of an unwatched host, unless it is too large."""
        self._absent.pop(host, None)
        if check_content(card) <= _LARGEST_ABSENT:
            self._absent[host] = card
        while len(self._absent) > _MOST_ABSENT:
            self._absent.popitem(last=False)

    def _admit(self, host: str, card: HostCard) -> bool:
        """Watch a host if it has a heartbeat and there is room; return whether it is watched."""
        if not self._has_heartbeat(host):
            return False
        now = time.monotonic()
        if len(self._hosts) >= MOST_HOSTS:
            longest = min(self._hosts, key=lambda name: self._hosts[name].heard_at)
            if now - self._hosts[longest].heard_at < SILENT_S:
                self.get_logger().warning(
                    f"{host} is left out of the studio: {MOST_HOSTS} other hosts are watched",
                    throttle_duration_sec=_TOLD_S,
                )
                return False
            self._dismiss(longest)
        self._absent.pop(host, None)
        self._hosts[host] = _Host(card=card, heard_at=now)
        self._hosts[host].subscriptions += [
            self._subscribe(topic, topic.name.replace(HOST, host))
            for topic in heard_by("studio")
            if HOST in topic.name and topic.name != _DETAILS
        ]
        if self._is_watched:
            self._subscribe_details(host)
        return True

    def _has_heartbeat(self, host: str) -> bool:
        return bool(self.count_publishers(f"{host}/heartbeat"))

    def _dismiss(self, host: str) -> None:
        """Stop watching a host until it has a heartbeat and there is room again."""
        one = self._hosts.pop(host)
        self._put_aside(host, one.card)
        self._destroy(one.subscriptions)
        self._destroy(one.details)
        for client in one.clients.values():
            self._calls.fail(client, f"{host} is gone")
            self.destroy_client(client)

    def _check_hosts(self) -> None:
        for host in list(self._hosts):
            if not self._has_heartbeat(host):
                self._dismiss(host)
        for host, card in list(self._absent.items()):
            self._admit(host, card)

    def _handle_tuning(self, host: str, message: Tunables | Tunings) -> None:
        now_s = self.get_clock().now().nanoseconds * 1e-9
        if isinstance(message, Tunables) and host in self._hosts:
            self._hosts[host].tunables = message
        kind = type(message).__name__
        self._receive(f"bt_agents_interfaces/msg/{kind}", message, now_s, False)
        self._read_values(host)

    def _read_values(self, host: str) -> None:
        known = self._hosts[host].tunables if host in self._hosts else None
        names = [one.name for one in known.tunables] if known is not None else []

        def report(values: Sequence[Any]) -> None:
            for name, value in zip(names, values, strict=False):
                self._value(host, name, parameter_value_to_python(value))

        def fail(reason: str) -> None:
            self.get_logger().warning(f"values of {host}: {reason}")

        self._get_parameters(host, names, report, fail)

    def _get_parameters(
        self,
        host: str,
        names: Sequence[str],
        on_values: Callable[[Sequence[Any]], None],
        on_failure: Callable[[str], None],
        known: Sequence[Any] = (),
    ) -> None:
        """Request values of parameters; returns fewer values than names if one is gone."""
        if host not in self._hosts:
            on_failure("it is gone")
            return

        def take(answer: Any) -> None:
            values = [*known, *answer.values]
            if not answer.values or len(values) >= len(names):
                on_values(values)
            else:
                self._get_parameters(host, names, on_values, on_failure, values)

        self._calls.call(
            self._client(self._hosts[host].clients, f"{host}/get_parameters"),
            GetParameters.Request(names=names[len(known) : len(known) + MOST_PARAMETERS]),
            deadline_s=_VALUES_S,
            on_answer=take,
            on_failure=on_failure,
        )

    def _client(self, clients: dict[str, Client], service: str) -> Client:
        """Return the client of a service among others, which it joins if it is new."""
        if service not in clients:
            kind = load_type(service_called(service).type)
            clients[service] = self.create_client(kind, service, qos_profile=qos.SERVICE)
        return clients[service]


class Handover:
    """Queue of calls from the ROS thread that another thread executes in order.

    A call that raises an exception does not block later ones. The queue is bounded. While it is
    full, the ROS thread takes no messages, so the middleware keeps the newest messages of each
    topic and drops older ones.

    Args:
        wake: Called by the ROS thread when the queue is no longer empty.
        on_failure: Called with the name of a failed call and its exception.
    """

    def __init__(
        self, wake: Callable[[], None], on_failure: Callable[[str, Exception], None]
    ) -> None:
        self._wake = wake
        self._on_failure = on_failure
        self._waiting: deque[tuple[partial[None], int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def to(self, handle: Callable[..., None]) -> Callable[..., None]:
        """Return a function for the ROS thread that queues a call of ``handle``."""

        def post(*values: Any) -> None:
            size = sum(largest_bytes(type(one)) for one in values if hasattr(one, "SLOT_TYPES"))
            with self._changed:
                is_first = not self._waiting
                self._waiting.append((partial(handle, *values), size))
                self._bytes += size
            if is_first:
                self._wake()

        return post

    def wait_for_room(self, limit_s: float) -> bool:
        """Wait for room in the queue; return whether there is any."""
        with self._changed:
            return self._changed.wait_for(self._has_room, limit_s)

    @property
    def waits(self) -> bool:
        """Whether the queue has calls."""
        return bool(self._waiting)

    def deliver(self, limit_s: float) -> None:
        """Execute queued calls for a time [s]; some may remain."""
        end = time.monotonic() + limit_s
        while self._waiting and time.monotonic() < end:
            # It stays in the queue until done, so calls queued meanwhile do not wake the thread.
            call, size = self._waiting[0]
            try:
                call()
            except Exception as error:
                self._on_failure(getattr(call.func, "__name__", "a call"), error)
            finally:
                with self._changed:
                    self._waiting.popleft()
                    self._bytes -= size
                    self._changed.notify()

    def _has_room(self) -> bool:
        few = len(self._waiting) < MOST_HANDED_OVER
        return few and self._bytes < MOST_HANDED_OVER_BYTES


class NodeThread:
    """Thread in which the node of a studio is created, spun and destroyed.

    Args:
        studio: Takes what the node receives.
        wake: As for :class:`Handover`.

    Attributes:
        handover: Queue for the messages that the node receives.
    """

    def __init__(self, studio: Studio, wake: Callable[[], None]) -> None:
        self._studio = studio
        self.handover = Handover(wake, studio.fail)
        self._made: Future[StudioNode] = Future()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ros", daemon=True)

    def start(self) -> StudioNode:
        """Start the thread, and return the node once it is created."""
        self._thread.start()
        return self._made.result()

    def stop(self) -> None:
        """Destroy the node and shut ROS down, within a bounded time."""
        self._stopped.set()
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        studio = self._studio
        to = self.handover.to
        try:
            with starting_ros(NO_LOG_FILE):
                node = StudioNode(
                    *(to(studio.receive), to(studio.beat), to(studio.value), to(studio.graph)),
                    namespace=os.environ.get("ROS_NAMESPACE", ""),
                )
        except BaseException as error:
            self._made.set_exception(error)
            rclpy.try_shutdown()
            return
        spinner = Spinner(node)
        self._made.set_result(node)
        try:
            while not self._stopped.is_set():
                if self.handover.wait_for_room(_ROOM_S):
                    spinner.spin_once()
        except ExternalShutdownException:
            pass
        finally:
            spinner.close()
            rclpy.try_shutdown()
