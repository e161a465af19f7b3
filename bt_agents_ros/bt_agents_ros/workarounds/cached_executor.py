# SPDX-License-Identifier: Apache-2.0
"""Single-threaded executor of every node, with a wait set that is reused between waits.

It replaces two executors of rclpy 7.1.6. ``SingleThreadedExecutor`` collects all entities before
each wait, and wraps each callback in a task. ``EventsExecutor`` is at least as fast as ours, but a
task that raises causes a segmentation fault (ros2/rclpy#1641, fixed by ros2/rclpy#1718), services
with coroutines never answer before rclpy 7.1.11, messages that wait after a callback that raises
stay in the queue, and its ``spin`` keeps the GIL. Remove this module when ``EventsExecutor`` of
the oldest supported rclpy passes ``tests/ros/test_executor.py``.
"""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from threading import get_ident
from typing import Any, TypeAlias

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.action import ActionServer
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.logging import get_logger
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_ros.limits import MIB
from bt_agents_ros.local_bus import LocalBus, LocalQueue
from bt_agents_ros.size_check import RefusalLog, check_bytes, may_exceed
from bt_agents_ros.workarounds.bounded_actions import SERVICES, take_bounded
from bt_agents_ros.workarounds.bounded_types import bounded
from bt_agents_ros.workarounds.cached_wait_set import CachedWaitSet
from bt_agents_ros.workarounds.departed_clients import DepartedClients
from bt_agents_ros.workarounds.local_endpoints import LocalClient, LocalService, action_data
from bt_agents_ros.workarounds.sliced_conversion import Slices, is_sliced, slices

_MESSAGES = 32
"""Maximum number of messages of one subscription to handle between two waits."""

_QUEUES_S = 0.002
"""Time for queued messages between two waits [s]."""

_POLLED, _POLLED_S = 1000, 0.03
"""The same for a polled group, whose queue a flood fills before the next poll."""

_BATCH_S = 0.05
"""Time for callbacks between two waits after which due timers precede the rest of them [s]."""

_LARGE_BYTES = 8 * MIB
"""Size of messages that take tens of milliseconds to take [bytes]."""

_LOCAL_S = 0.01
"""Time between two waits for items that nodes of this process send to each other [s]."""

_Call: TypeAlias = Callable[[], Coroutine[Any, Any, None]]


class CachedExecutor(Executor):
    """Executor that runs one callback after the other, in the thread that spins it.

    It calls callbacks and treats errors like ``SingleThreadedExecutor``, but rebuilds the wait set
    only when a node, an entity or a callback group has changed. Messages and requests beyond the
    limits reach no callback: they are logged, and requests are answered. Due timers do not wait
    for all of many long callbacks, so that a node keeps sending its heartbeat. A large message is
    converted in slices with other work in between; the next message of the topic waits, and is
    taken after everything else. Messages for a polled group
    (:class:`~bt_agents_ros.workarounds.cached_wait_set.PolledGroup`) do not wake it.

    Args:
        bus: Bus between its nodes. Its items and the middleware's take turns.
    """

    # rclpy's __del__ reads this, even if an interrupt ends __init__ before rclpy sets it.
    _sigint_gc: Any = None

    def __init__(self, *, context: Any = None, bus: LocalBus | None = None) -> None:
        super().__init__(context=context)
        self._bus = bus
        self._local_until = 0.0
        self._thread = get_ident()
        self._wait_set: CachedWaitSet | None = None
        self._changed = False
        self._batch: deque[Callable[[], object]] = deque()
        self._new_tasks: deque[_Task] = deque()
        self._suspended: list[_Task] = []
        self._had_message: set[Any] = set()
        self._has_large: set[Any] = set()
        self._in_slices: set[Any] = set()
        self._converted: dict[Any, _Call] = {}
        self._has_waited = False
        self._task_ended = False
        self._look_at_timers = 0.0
        self._refusals = RefusalLog(time.monotonic)
        self._departed = DepartedClients(time.monotonic)
        self._takes: dict[str, Callable[[Any], _Call | None]] = {
            "waitable": self._take_waitable,
            "timer": self._take_due_timer,
            "subscription": self._take_subscription,
            "guard_condition": self._take_guard_condition,
            "client": self._take_client,
            "service": self._take_service,
        }

    def add_node(self, node: Any) -> bool:
        added = super().add_node(node)
        self.wake()
        return bool(added)

    def remove_node(self, node: Any) -> None:
        super().remove_node(node)
        self.wake()
        if get_ident() == self._thread:
            self._release_wait_set()

    def wake(self) -> None:
        """Request a new wait set; callable from any thread."""
        self._changed = True
        if get_ident() != self._thread:
            super().wake()

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Future:
        """Schedule a function or a coroutine; callable from any thread."""
        task = _Task(callback, args, kwargs, executor=self)
        self._new_tasks.append(task)
        if get_ident() != self._thread:
            super().wake()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self._batch.clear()
        self._converted.clear()
        if self._bus is not None:
            self._bus.write_out()
        self._release_wait_set()
        return bool(super().shutdown(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Do one piece of work; wait if there is none.

        Raises:
            ExternalShutdownException: The context was shut down.
            Exception: An exception of a callback.
        """
        self._thread = get_ident()
        if self._bus is not None and not self._batch and not self._is_shutdown:
            self._collect_local(self._bus)
        if not self._batch and not self._is_shutdown:
            # Tasks alternate with waits, so that neither starves the other.
            if self._has_waited and (self._new_tasks or self._suspended):
                self._has_waited = False
                self._collect_tasks()
            else:
                self._has_waited = True
                self._wait(timeout_sec)
        if self._batch:
            self._batch.popleft()()
            if self._batch and time.monotonic() >= self._look_at_timers:
                self._put_timers_first()
        if self._changed:
            self._release_wait_set()

    def _release_wait_set(self) -> None:
        self._changed = False
        self._has_large.clear()
        if self._wait_set is not None:
            self._wait_set.release()
            self._wait_set = None

    def _put_timers_first(self) -> None:
        self._look_at_timers = time.monotonic() + _BATCH_S
        if self._wait_set is not None:
            for timer in self._wait_set.timers:
                # Taking it checks whether it is due.
                self._batch.appendleft(partial(self._run_callback, self._take_due_timer, timer))

    def _collect_local(self, bus: LocalBus) -> None:
        """Put items of the bus into the batch, or if there are none, publications for others."""
        if time.monotonic() < self._local_until:
            ready = [task for task in self._suspended if task.is_ready]
            if ready:
                self._suspended = [task for task in self._suspended if not task.is_ready]
            for task in (*self._new_tasks, *ready):
                self._batch.append(partial(self._resume, task))
            self._new_tasks.clear()
            for queue in _ready(bus):
                take = partial(self._take_local, bus, queue)
                self._batch.append(partial(self._run_callback, take, queue.entity))
        if not self._batch:
            self._batch.extend([bus.write_next] * len(bus.outgoing))

    def _collect_tasks(self) -> None:
        waiting, self._suspended = self._suspended, []
        self._task_ended = False
        for task in [*(self._new_tasks.popleft() for _ in range(len(self._new_tasks))), *waiting]:
            self._batch.append(partial(self._resume, task))

    def _wait(self, timeout_s: float | None) -> None:
        if self._changed:
            self._release_wait_set()
        if self._wait_set is None:
            self._wait_set = CachedWaitSet(
                self.get_nodes(), (self._guard.handle, self._sigint_gc.handle), self._context
            )
        converted = [one for one in self._converted if one.callback_group.can_execute(one)]
        ended = self._task_ended and self._suspended
        local = self._bus is not None and _ready(self._bus)
        if self._new_tasks or converted or ended or local:
            # With this the wait returns at once; a timeout of zero would take a tenth of a ms.
            self._guard.trigger()
        ready = self._wait_set.wait(timeout_s)
        if not self._context.ok():
            raise ExternalShutdownException()
        if self._has_large:
            ready.sort(key=lambda one: one[1] in self._has_large)
        had_message = self._had_message
        self._had_message = {entity for kind, entity in ready if kind == "subscription"}
        now = time.monotonic()
        until = now + _QUEUES_S
        self._local_until = now + _LOCAL_S
        self._look_at_timers = until + _BATCH_S
        for subscription in converted:
            self._batch.append(partial(self._run_callback, self._take_converted, subscription))
        for kind, entity in ready:
            if kind == "polled":
                self._batch.append(partial(self._drain, entity, _POLLED, now + _POLLED_S))
            elif entity in had_message:
                self._batch.append(partial(self._drain, entity, _MESSAGES, until))
            else:
                self._batch.append(partial(self._run_callback, self._takes[kind], entity))

    def _drain(self, subscription: Any, left: int, until: float) -> None:
        """Handle queued messages of a topic that had one at the previous wait, one at a time."""
        took_one = self._run_callback(self._take_subscription, subscription)
        if took_one and left > 1 and time.monotonic() < until:
            self._batch.append(partial(self._drain, subscription, left - 1, until))

    def _run_callback(self, take: Callable[[Any], _Call | None], entity: Any) -> bool:
        """Run the callback of an entity; return False if there was nothing left to take."""
        group = entity.callback_group
        if not group.beginning_execution(entity):
            if isinstance(entity, GuardCondition):
                entity.trigger()
            return False
        is_over = True
        try:
            try:
                call = take(entity)
                if call is None:
                    with entity.handle:
                        return False
            except InvalidHandle:
                # It was destroyed, perhaps without a call of wake().
                self._changed = True
                return False
            coroutine = call()
            try:
                awaited = coroutine.send(None)
            except StopIteration:
                return True
            is_over = False
        finally:
            if is_over:
                group.ending_execution(entity)
        task = _Task(coroutine, (), {}, executor=self)
        task.awaited = awaited
        task.entity = entity
        self._suspended.append(task)
        if not group.can_execute(entity):
            self._changed = True
        return True

    def _resume(self, task: _Task) -> None:
        try:
            task.resume()
        finally:
            if not task.is_over:
                self._suspended.append(task)
            else:
                self._task_ended = True
                if task.entity is not None:
                    group = task.entity.callback_group
                    if not group.can_execute(task.entity):
                        self._changed = True
                    group.ending_execution(task.entity)

    def _take_waitable(self, waitable: Any) -> _Call:
        """Take the data of a waitable and return its callback.

        rclpy sets the executor of every future of a waitable each time; an action server has one
        for each goal of the last minutes, so this method skips finished ones.
        """
        data, refused = take_bounded(waitable, self._departed)
        for reason in refused:
            self._log_refusal(waitable, waitable._node.get_logger().name, "an action", reason)
        return self._execution_of(waitable, data)

    def _execution_of(self, waitable: Any, data: Any) -> _Call:
        async def execute() -> None:
            for future in waitable._futures:
                if not future.done():
                    future._set_executor(self)
            began = self._departed.clock()
            await waitable.execute(data)
            if isinstance(waitable, ActionServer):
                for part in SERVICES.keys() & data.keys():
                    header, _ = data[part]
                    self._departed.on_answered(
                        lambda: waitable._node, SERVICES[part], header, began
                    )

        return execute

    def _take_local(self, bus: LocalBus, queue: LocalQueue, entity: Any) -> _Call:
        """Return the callback of an entity with the oldest item in one of its queues."""
        item = queue.take()
        if item is None:
            return _nothing
        if isinstance(entity, (LocalService, LocalClient)):
            return entity.call_of(item, self)
        if queue.part:
            return self._execution_of(entity, action_data(queue, item))
        message = serialize_message(item.message) if entity.raw else item.message
        info = {
            "source_timestamp": item.stamp_ns,
            "received_timestamp": time.time_ns(),
            "publication_sequence_number": None,
            "reception_sequence_number": None,
        }
        return _callback_of(entity, message, info)

    def _take_subscription(self, subscription: Any) -> _Call | None:
        """Return the callback of a subscription with its next message; None without one.

        The message is taken as bytes, so that a large one is refused before it becomes an object.
        """
        if subscription in self._in_slices:
            return None
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, True)
        if taken is None:
            return None
        message, info = taken
        kind, raw = subscription.msg_type, subscription.raw
        if len(message) >= _LARGE_BYTES:
            self._has_large.add(subscription)
        elif self._has_large:
            self._has_large.discard(subscription)
        try:
            check_bytes(kind, len(message))
            if not raw and is_sliced(kind, len(message)):
                made = slices(kind, message, time.monotonic)
                self._convert_slice(subscription, made, info)
                return _nothing
            if not raw:
                message = _deserialized(kind, message)
        except Refused as refused:
            self._log_refused_message(subscription, refused)
            return _nothing
        return _callback_of(subscription, message, info)

    def _convert_slice(self, subscription: Any, made: Slices, info: Any) -> None:
        """Convert a slice of a message; its callback or its next slice gets its own turn."""
        self._in_slices.discard(subscription)
        try:
            next(made)
        except StopIteration as end:
            self._converted[subscription] = _callback_of(subscription, end.value, info)
        except Refused as refused:
            self._log_refused_message(subscription, refused)
            return
        else:
            self.create_task(self._convert_slice, subscription, made, info)
        self._in_slices.add(subscription)

    def _take_converted(self, subscription: Any) -> _Call:
        """Return the callback of a subscription with a message that was converted in slices."""
        self._in_slices.discard(subscription)
        call = self._converted.pop(subscription)
        with subscription.handle:
            return call

    def _log_refused_message(self, subscription: Any, refused: Refused) -> None:
        self._log_refusal(subscription, subscription.logger_name, subscription.topic_name, refused)

    def _take_service(self, service: Any) -> _Call:
        """Return the callback of a service with its next request, or that refuses a large one."""
        with service.handle:
            request, header = service.handle.service_take_request(
                bounded(service.srv_type.Request)
            )
        if header is None:
            return _nothing

        async def execute() -> None:
            response = service.srv_type.Response()
            if isinstance(request, Refused):
                self._log_refusal(service, service.logger_name, service.service_name, request)
                _answer_refused(response, request)
            else:
                response = await await_or_execute(service.callback, request, response)
            self._departed.answer(
                lambda: next(iter(self.get_nodes()), None),
                service.service_name,
                header,
                partial(service.send_response, response, header),
            )

        return execute

    def _take_client(self, client: Any) -> _Call:
        """Return a callback that passes the next answer, or its refusal, to its future."""
        with client.handle:
            header, response = client.handle.take_response(bounded(client.srv_type.Response))
        if header is None:
            return _nothing
        sequence_number = header.request_id.sequence_number

        async def execute() -> None:
            if isinstance(response, Refused):
                self._log_refusal(client, client.logger_name, client.service_name, response)
            try:
                future = client.get_pending_request(sequence_number)
            except KeyError:
                return  # nothing waits for it any more
            future._set_executor(self)
            if isinstance(response, Refused):
                future.set_exception(response)
            else:
                future.set_result(response)

        return execute

    def _log_refusal(self, entity: Any, logger: str, name: str, refused: Refused) -> None:
        line = self._refusals.line(entity, name, refused)
        if line is not None:
            get_logger(logger).warning(line)

    def _take_due_timer(self, timer: Any) -> _Call | None:
        """Return the callback of a timer, unless an earlier callback stopped the timer."""
        try:
            with timer.handle:
                is_due = timer.handle.is_timer_ready()
        except InvalidHandle:
            return None
        return self._take_timer(timer) if is_due else _nothing


def _deserialized(kind: Any, message: bytes) -> Any:
    """Return a message from its bytes.

    Raises:
        Refused: ``TOO_LARGE``, or ``MALFORMED`` if the bytes do not fit the type.
    """
    # Few are large enough, and the stand-in takes 4 µs.
    taken = bounded(kind) if may_exceed(kind, len(message)) else kind
    try:
        made = deserialize_message(message, taken)
    except Exception as error:
        # rclpy's exceptions for bad bytes have no common base class.
        raise Refused(
            RefusalCode.MALFORMED, f"{len(message)} bytes are not a {kind.__name__}: {error}"
        ) from None
    if isinstance(made, Refused):
        raise made
    return made


def _callback_of(subscription: Any, message: Any, info: Any) -> _Call:
    has_info = subscription._callback_type is not Subscription.CallbackType.MessageOnly
    arguments = (message, info) if has_info else (message,)

    async def execute() -> None:
        await await_or_execute(subscription.callback, *arguments)

    return execute


def _ready(bus: LocalBus) -> list[LocalQueue]:
    """Return the queues with an item that a callback may take now."""
    return [one for one in bus.pending if one.entity.callback_group.can_execute(one.entity)]


async def _nothing() -> None:
    """Callback of a stopped timer, or of a message that was refused or is gone."""


def _answer_refused(response: Any, refused: Refused) -> None:
    """Set the refusal in the fields of our responses, and of those about parameters."""
    if hasattr(response, "code"):
        response.code = refused.code
        response.message = refused.reason
    elif hasattr(response, "message"):
        response.message = str(refused)
    elif isinstance(response, SetParameters.Response):
        response.results = [SetParametersResult(reason=str(refused))]
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = SetParametersResult(reason=str(refused))


class _Task(Future):
    """Function to call, or coroutine to resume until its end.

    Attributes:
        awaited: Future that the coroutine awaits; None before its start, or for a bare yield.
        entity: Owner of the callback; None for tasks of :meth:`CachedExecutor.create_task`.
    """

    def __init__(self, call: Any, args: Any, kwargs: Any, *, executor: Executor) -> None:
        super().__init__(executor=executor)
        self.awaited: Any = None
        self.entity: Any = None
        self._function: Callable[[], Any] = lambda: call(*args, **kwargs)
        self._coroutine: Any = call if inspect.iscoroutine(call) else None
        if inspect.iscoroutinefunction(call):
            self._coroutine = self._function()

    @property
    def is_over(self) -> bool:
        """True when it has ended or was cancelled."""
        return bool(self.done() or self.cancelled())

    @property
    def is_ready(self) -> bool:
        """True unless it awaits a future that is not done."""
        return self.awaited is None or bool(self.awaited.done() or self.awaited.cancelled())

    def cancel(self) -> None:
        """Close the coroutine and never resume it again."""
        if not self.is_over and self._coroutine is not None:
            self._coroutine.close()
        super().cancel()

    def resume(self) -> None:
        """Call the function, or resume the coroutine if its awaited future is done.

        Raises:
            BaseException: Any exception of the function, which is also stored.
        """
        if self.is_over or not self.is_ready:
            return
        try:
            if self._coroutine is None:
                result = self._function()
            else:
                try:
                    self.awaited = self._coroutine.send(None)
                    return
                except StopIteration as end:
                    result = end.value
        except BaseException as error:
            self.set_exception(error)
            self.exception()  # else rclpy warns that it was never retrieved
            raise
        self.set_result(result)
