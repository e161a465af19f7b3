# SPDX-License-Identifier: Apache-2.0
"""The executor of every node: as rclpy's single-threaded one, with a wait set that is kept."""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from threading import get_ident
from typing import Any, TypeAlias

from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.task import Future

from bt_agents_ros.workarounds.cached_wait_set import CachedWaitSet

_MESSAGES = 32
"""So many messages of a queue are heard before it is looked what else there is to do."""

_QUEUES_S = 0.002
"""For so long queues are heard before it is looked what else there is to do [s]."""

_Call: TypeAlias = Callable[[], Coroutine[Any, Any, None]]


class CachedExecutor(Executor):
    """Calls one callback after the other, in the thread that turns it.

    What is called, when, and what becomes of an error is as with ``SingleThreadedExecutor``. That
    one collects anew for each wait what there is to wait for, and wraps each callback in a task;
    this one collects when a node, an entity or a callback group has changed.

    rclpy's ``EventsExecutor`` is as quick or quicker. But a task that raises is a segmentation
    fault there, services of coroutines never answer before rclpy 7.1.11, and messages that wait
    behind a callback that raises stay in the queue.

    Args:
        context: Of its nodes; None takes the default one.
    """

    def __init__(self, *, context: Any = None) -> None:
        super().__init__(context=context)
        self._thread = get_ident()
        self._wait_set: CachedWaitSet | None = None
        self._changed = False
        self._batch: deque[Callable[[], object]] = deque()
        self._begun: deque[_Task] = deque()
        self._suspended: list[_Task] = []
        self._heard: set[Any] = set()
        self._has_waited = False
        self._has_moved = False
        self._takes: dict[str, Callable[[Any], _Call | None]] = {
            "waitable": self._take_waitable,
            "timer": self._take_due_timer,
            "subscription": self._take_subscription,
            "guard_condition": self._take_guard_condition,
            "client": self._take_client,
            "service": self._take_service,
        }

    def add_node(self, node: Any) -> bool:
        """Turn a node from now on; return False when it is turned already."""
        added = super().add_node(node)
        self.wake()
        return bool(added)

    def remove_node(self, node: Any) -> None:
        """Turn a node no more."""
        super().remove_node(node)
        self.wake()
        if get_ident() == self._thread:
            self._let_go()

    def wake(self) -> None:
        """Collect anew what there is to wait for; any thread may ask for it."""
        self._changed = True
        if get_ident() != self._thread:
            super().wake()

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Future:
        """Have a function called or a coroutine run to its end; any thread may ask for it."""
        task = _Task(callback, args, kwargs, executor=self)
        self._begun.append(task)
        if get_ident() != self._thread:
            super().wake()
        return task

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Turn nothing any more."""
        self._batch.clear()
        self._let_go()
        return bool(super().shutdown(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Do one piece of work; wait for it if there is none.

        Args:
            timeout_sec: How long to wait at most [s]; None for no limit.

        Raises:
            ExternalShutdownException: The context was shut down.
            Exception: What a callback raises.
        """
        self._thread = get_ident()
        if not self._batch and not self._is_shutdown:
            # Tasks have their turn between two waits, so that neither keeps the other from it.
            if self._has_waited and (self._begun or self._suspended):
                self._has_waited = False
                self._collect_tasks()
            else:
                self._has_waited = True
                self._wait(timeout_sec)
        if self._batch:
            self._batch.popleft()()
        if self._changed:
            self._let_go()

    def _let_go(self) -> None:
        """Let what has been destroyed be gone."""
        self._changed = False
        if self._wait_set is not None:
            self._wait_set.let_go()
            self._wait_set = None

    def _collect_tasks(self) -> None:
        waiting, self._suspended = self._suspended, []
        self._has_moved = False
        for task in [*(self._begun.popleft() for _ in range(len(self._begun))), *waiting]:
            self._batch.append(partial(self._go_on, task))

    def _wait(self, timeout_s: float | None) -> None:
        if self._changed:
            self._let_go()
        if self._wait_set is None:
            self._wait_set = CachedWaitSet(
                self.get_nodes(), (self._guard.handle, self._sigint_gc.handle), self._context
            )
        if self._begun or (self._has_moved and self._suspended):
            # With this it returns at once; with a timeout of zero it takes a tenth of a ms.
            self._guard.trigger()
        ready = self._wait_set.wait(timeout_s)
        if not self._context.ok():
            raise ExternalShutdownException()
        heard, self._heard = self._heard, {one for kind, one in ready if kind == "subscription"}
        until = time.monotonic() + _QUEUES_S
        for kind, entity in ready:
            if entity in heard:
                self._batch.append(partial(self._hear, entity, _MESSAGES, until))
            else:
                self._batch.append(partial(self._call, self._takes[kind], entity))

    def _hear(self, subscription: Any, left: int, until: float) -> None:
        """Hear a message of a topic that had one at the wait before, and so may have a queue."""
        heard = self._call(self._take_subscription, subscription)
        if heard and left > 1 and time.monotonic() < until:
            self._batch.append(partial(self._hear, subscription, left - 1, until))

    def _call(self, take: Callable[[Any], _Call | None], entity: Any) -> bool:
        """Call something; return False if there was nothing any more."""
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
                # It has been destroyed, and it may be that nobody has said so.
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

    def _go_on(self, task: _Task) -> None:
        try:
            task.go_on()
        finally:
            if not task.is_over:
                self._suspended.append(task)
            else:
                self._has_moved = True
                if task.entity is not None:
                    self._end(task.entity)

    def _end(self, entity: Any) -> None:
        """Note that a callback that was suspended has ended, for which its group may wait."""
        group = entity.callback_group
        if not group.can_execute(entity):
            self._changed = True
        group.ending_execution(entity)

    def _take_waitable(self, waitable: Any) -> _Call:
        """Return what to do for a waitable, after its data has been taken.

        rclpy gives it the executor for every future that it keeps, an action server for each goal
        that has ended some time ago.
        """
        data = waitable.take_data()

        async def execute() -> None:
            for future in waitable._futures:
                if not future.done():
                    future._set_executor(self)
            await waitable.execute(data)

        return execute

    def _take_due_timer(self, timer: Any) -> _Call | None:
        """Return what a timer calls, if none of the callbacks before has stopped it."""
        try:
            with timer.handle:
                is_due = timer.handle.is_timer_ready()
        except InvalidHandle:
            return None
        return self._take_timer(timer) if is_due else _nothing


async def _nothing() -> None:
    """Stands for the callback of a timer that has been stopped."""


class _Task(Future):
    """A function to be called, or a coroutine that is resumed until its end.

    Attributes:
        awaited: What the coroutine waits for, where rclpy says so; else None.
        entity: Whose callback it is; None for a task.
    """

    def __init__(self, call: Any, args: Any, kwargs: Any, *, executor: Executor) -> None:
        super().__init__(executor=executor)
        self.awaited: Any = None
        self.entity: Any = None
        self._call: Callable[[], Any] = lambda: call(*args, **kwargs)
        self._coroutine: Any = call if inspect.iscoroutine(call) else None
        if inspect.iscoroutinefunction(call):
            self._coroutine = self._call()

    @property
    def is_over(self) -> bool:
        """True when there is nothing to resume any more."""
        return bool(self.done() or self.cancelled())

    def cancel(self) -> None:
        """Resume it no more."""
        if not self.is_over and self._coroutine is not None:
            self._coroutine.close()
        super().cancel()

    def go_on(self) -> None:
        """Call it, or resume it if what it waits for has come.

        Raises:
            BaseException: What it raises, which is also its result.
        """
        if self.is_over:
            return
        if self.awaited is not None and not (self.awaited.done() or self.awaited.cancelled()):
            return
        try:
            if self._coroutine is None:
                result = self._call()
            else:
                try:
                    self.awaited = self._coroutine.send(None)
                    return
                except StopIteration as end:
                    result = end.value
        except BaseException as error:
            self.set_exception(error)
            self.exception()  # rclpy would complain that nobody has asked for it
            raise
        self.set_result(result)
