# SPDX-License-Identifier: Apache-2.0
"""Single-threaded executor of every node, with a wait set that is reused between waits.

It stands in for two executors of rclpy 7.1.6. ``SingleThreadedExecutor`` collects anew for each
wait what there is to wait for, and wraps each callback in a task. ``EventsExecutor`` is as quick
or quicker than ours, but there a task that raises is a segmentation fault (ros2/rclpy#1641,
fixed by ros2/rclpy#1718), services of coroutines never answer before rclpy 7.1.11, messages that
wait behind a callback that raises stay in the queue, and its ``spin`` keeps the GIL. This module
can go when ``EventsExecutor`` of the oldest supported rclpy passes ``tests/ros/test_executor.py``.
"""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from threading import get_ident
from typing import Any, TypeAlias

from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException, await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.logging import get_logger
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future

from bt_agents_core.errors import Refused
from bt_agents_ros.size_check import OversizeLog, check_bytes, check_fields, check_request
from bt_agents_ros.workarounds.cached_wait_set import CachedWaitSet
from bt_agents_ros.workarounds.sender_identity import IdentifiedRequest

_MESSAGES = 32
"""Messages of one subscription that are handled at most between two waits."""

_QUEUES_S = 0.002
"""Time for handling queued messages between two waits [s]."""

_Call: TypeAlias = Callable[[], Coroutine[Any, Any, None]]


class CachedExecutor(Executor):
    """Executor that runs one callback after the other, in the thread that spins it.

    What is called, when, and what becomes of an error is as with ``SingleThreadedExecutor``; the
    wait set is made anew only when a node, an entity or a callback group has changed. Messages and
    requests beyond the limits come to no callback: they are logged, requests are answered.
    """

    # An interrupt may end __init__ before rclpy has set it, and the __del__ of rclpy reads it.
    _sigint_gc: Any = None

    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)
        self._thread = get_ident()
        self._wait_set: CachedWaitSet | None = None
        self._changed = False
        self._batch: deque[Callable[[], object]] = deque()
        self._new_tasks: deque[_Task] = deque()
        self._suspended: list[_Task] = []
        self._had_message: set[Any] = set()
        self._has_waited = False
        self._task_ended = False
        self._oversize = OversizeLog(time.monotonic)
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
        """Have the wait set made anew; from any thread."""
        self._changed = True
        if get_ident() != self._thread:
            super().wake()

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Future:
        """Schedule a function or a coroutine; from any thread."""
        task = _Task(callback, args, kwargs, executor=self)
        self._new_tasks.append(task)
        if get_ident() != self._thread:
            super().wake()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        self._batch.clear()
        self._release_wait_set()
        return bool(super().shutdown(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Do one piece of work; wait for it if there is none.

        Raises:
            ExternalShutdownException: The context was shut down.
            Exception: What a callback raises.
        """
        self._thread = get_ident()
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
        if self._changed:
            self._release_wait_set()

    def _release_wait_set(self) -> None:
        self._changed = False
        if self._wait_set is not None:
            self._wait_set.release()
            self._wait_set = None

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
        if self._new_tasks or (self._task_ended and self._suspended):
            # With this it returns at once; with a timeout of zero it takes a tenth of a ms.
            self._guard.trigger()
        ready = self._wait_set.wait(timeout_s)
        if not self._context.ok():
            raise ExternalShutdownException()
        had_message = self._had_message
        self._had_message = {entity for kind, entity in ready if kind == "subscription"}
        until = time.monotonic() + _QUEUES_S
        for kind, entity in ready:
            if entity in had_message:
                self._batch.append(partial(self._drain, entity, _MESSAGES, until))
            else:
                self._batch.append(partial(self._run_callback, self._takes[kind], entity))

    def _drain(self, subscription: Any, left: int, until: float) -> None:
        """Handle queued messages of a topic that had one at the wait before, one at a time."""
        took_one = self._run_callback(self._take_subscription, subscription)
        if took_one and left > 1 and time.monotonic() < until:
            self._batch.append(partial(self._drain, subscription, left - 1, until))

    def _run_callback(self, take: Callable[[Any], _Call | None], entity: Any) -> bool:
        """Run the callback of an entity; return False if there was nothing to take any more."""
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
                # It has been destroyed, perhaps without a call of wake().
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
        """Return the callback of a waitable, after its data has been taken.

        rclpy sets the executor of every future of a waitable each time; an action server has one
        for each goal of the last minutes, which is why finished ones are skipped here.
        """
        data = waitable.take_data()

        async def execute() -> None:
            for future in waitable._futures:
                if not future.done():
                    future._set_executor(self)
            await waitable.execute(data)

        return execute

    def _take_subscription(self, subscription: Any) -> _Call | None:
        """Return the callback of a subscription with its next message; None without one.

        The message is taken as bytes, so that a large one is refused before it is made an object.
        """
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, True)
        if taken is None:
            return None
        message, info = taken
        size = len(message)
        try:
            check_bytes(subscription.msg_type, size)
            if not subscription.raw:
                message = deserialize_message(message, subscription.msg_type)
                check_fields(message, size)
        except Refused as refused:
            self._log_refusal(subscription, subscription.topic_name, refused)
            return _nothing
        has_info = subscription._callback_type is not Subscription.CallbackType.MessageOnly
        arguments = (message, info) if has_info else (message,)

        async def execute() -> None:
            await await_or_execute(subscription.callback, *arguments)

        return execute

    def _take_service(self, service: Any) -> _Call:
        """Return the callback of a service with its next request, or what answers a large one."""
        with service.handle:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        if header is None:
            return _nothing

        async def execute() -> None:
            response = service.srv_type.Response()
            try:
                check_request(
                    request.request if isinstance(request, IdentifiedRequest) else request
                )
            except Refused as refused:
                self._log_refusal(service, service.service_name, refused)
                _answer_refused(response, refused)
            else:
                response = await await_or_execute(service.callback, request, response)
            service.send_response(response, header)

        return execute

    def _log_refusal(self, entity: Any, name: str, refused: Refused) -> None:
        line = self._oversize.line(entity, name, refused)
        if line is not None:
            get_logger(entity.logger_name).warning(line)

    def _take_due_timer(self, timer: Any) -> _Call | None:
        """Return the callback of a timer, unless a callback before has stopped the timer."""
        try:
            with timer.handle:
                is_due = timer.handle.is_timer_ready()
        except InvalidHandle:
            return None
        return self._take_timer(timer) if is_due else _nothing


async def _nothing() -> None:
    """Callback of a timer that has been stopped, or of a message that was refused or is gone."""


def _answer_refused(response: Any, refused: Refused) -> None:
    """Set the fields by which responses of ``bt_agents_interfaces`` say that they refuse."""
    if hasattr(response, "code"):
        response.code = refused.code
        response.message = refused.reason
    else:
        response.message = str(refused)


class _Task(Future):
    """Function to be called, or coroutine that is resumed until its end.

    Attributes:
        awaited: Future that the coroutine awaits; None before its start, or for a bare yield.
        entity: Owner of the callback; None for a task of :meth:`CachedExecutor.create_task`.
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

    def cancel(self) -> None:
        """Close the coroutine; it is resumed no more."""
        if not self.is_over and self._coroutine is not None:
            self._coroutine.close()
        super().cancel()

    def resume(self) -> None:
        """Call the function, or resume the coroutine if what it awaits is done.

        Raises:
            BaseException: Whatever it raises, which is also stored as its exception.
        """
        if self.is_over:
            return
        if self.awaited is not None and not (self.awaited.done() or self.awaited.cancelled()):
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
