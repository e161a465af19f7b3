# SPDX-License-Identifier: Apache-2.0
"""Writes lines of the log without reading the source of whoever writes them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from rclpy.impl import rcutils_logger
from rclpy.impl.implementation_singleton import rclpy_implementation

# rclpy tells apart who limits how often a line is written by the first frame outside of these
# files, without symbolic links.
rcutils_logger._internal_callers.append(str(Path(__file__).resolve()))


class QuickLogger(rcutils_logger.RcutilsLogger):
    """Writes a line in a thirtieth of the time that rclpy takes to find out where it is from.

    rclpy looks at the file system for each line, and at the source of each frame above it.
    """

    def log(self, message: str, severity: Any, **filters: Any) -> bool:
        """Write a line; as in rclpy, which still takes those that are written only sometimes."""
        if filters:
            return bool(super().log(message, severity, **filters))
        if not self.is_enabled_for(severity):
            return False
        frame = sys._getframe(1)
        while frame.f_code.co_filename == rcutils_logger.__file__ and frame.f_back is not None:
            frame = frame.f_back
        code = frame.f_code
        rclpy_implementation.rclpy_logging_rcutils_log(
            severity, self.name, message, code.co_name, code.co_filename, frame.f_lineno
        )
        return True
