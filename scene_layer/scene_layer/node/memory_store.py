# SPDX-License-Identifier: Apache-2.0
"""Stores the memory in a file, and serves requests to forget persons and places."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future as ThreadFuture
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.profile_layers import LONGEST_LAYER, PERSON, PLACE
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_core.worker_thread import WorkerThread
from bt_agents_interfaces.srv import ManageProfiles
from bt_agents_ros import qos
from bt_agents_ros.timers import FuturePoller, steady_timer
from scene_layer.memory import DamagedMemoryError, Memory, read_memory, save_memory, set_aside

SAVE_S = 10.0
"""Time between two saves of changes [s]; changes are also saved at the end."""

_SHOWN = LONGEST_LAYER


class MemoryStore:
    """Reads the memory at the start, saves it regularly, and serves ``~/manage``.

    Args:
        memory: Filled from the file.
        path: The file; None keeps nothing after the end of the node.
        known: Returns the present persons who may be stored.

    Raises:
        BtAgentsError: The file is not a memory file, or cannot be read or moved aside.
    """

    def __init__(
        self,
        node: Node,
        memory: Memory,
        space: SceneSpace,
        path: Path | None,
        known: Callable[[], frozenset[str]],
    ) -> None:
        self._node = node
        self._memory = memory
        self._space = space
        self._path = path
        self._known = known
        if path is not None:
            self._read(path)
        self._disk = WorkerThread("memory")
        self._poller = FuturePoller(node)
        self._saved = memory.changes
        self._saving: ThreadFuture[None] | None = None
        if path is not None:
            steady_timer(node, SAVE_S, self._save_changes)
        # A request that waits for the disk blocks no other.
        group = ReentrantCallbackGroup()
        node.create_service(
            ManageProfiles, "~/manage", self._manage, qos_profile=qos.SERVICE, callback_group=group
        )

    @property
    def lasts(self) -> bool:
        """Whether the memory is kept after the end of the node."""
        return self._path is not None

    def request_stop(self) -> None:
        """Save the changes in the disk thread, after its current work."""
        if self._memory.changes != self._saved:
            self._save()

    def stopped(self) -> bool:
        return self._saving is None or self._saving.done()

    def close(self) -> None:
        """End the disk thread."""
        self._disk.shutdown()

    def _read(self, path: Path) -> None:
        try:
            self._memory.restore(*read_memory(path, self._space, time.time()))
        except DamagedMemoryError as error:
            try:
                stored = set_aside(path)
            except OSError as problem:
                text = problem.strerror or problem
                raise BtAgentsError(f"{error}; it cannot be set aside: {text}") from None
            self._node.get_logger().error(
                f"nobody is remembered: {error}; it is kept as {stored}, the memory begins empty"
            )

    def _save_changes(self) -> None:
        if self._memory.changes != self._saved and self.stopped():
            self._save()

    def _save(self) -> ThreadFuture[None] | None:
        if self._path is None:
            return None
        self._saved = self._memory.changes
        stored = self._memory.snapshot(self._known())
        self._saving = self._disk.submit(save_memory, self._path, *stored)
        self._poller.watch(self._saving, self._on_saved)
        return self._saving

    def _on_saved(self, trouble: str) -> None:
        if trouble:
            self._saved = -1
            self._node.get_logger().error(
                f"the memory is not saved, it is tried again: {trouble}",
                throttle_duration_sec=60.0,
            )

    async def _manage(self, request: Any, response: Any) -> Any:
        if request.action != ManageProfiles.Request.FORGET:
            response.code = RefusalCode.UNKNOWN_ACTION
            response.message = (
                f"action {request.action}, expected {ManageProfiles.Request.FORGET} (forget): the "
                "scene layer has no profiles, it remembers what was measured"
            )
            return response
        layer = request.layer
        kind, _, name = layer.partition("/")
        if kind == PERSON and name:
            found = self._memory.forget(person=name)
        elif kind == PLACE and name:
            found = self._memory.forget(place=name)
        else:
            response.code = RefusalCode.UNKNOWN_LAYER
            response.message = (
                f"no layer '{layer[:_SHOWN]}', expected person/NAME or place/NAME, for example "
                "person/anna"
            )
            return response
        saving = self._save()
        trouble = await self._poller.error_of(saving) if saving is not None else ""
        response.accepted = not trouble
        response.code = RefusalCode.STORAGE_FULL if trouble else ""
        response.message = (
            f"{layer[:_SHOWN]} is forgotten" if found else f"nothing was known of {layer[:_SHOWN]}"
        ) + (f", but its file still has it, which is tried again: {trouble}" if trouble else "")
        self._node.get_logger().info(response.message)
        return response
