# SPDX-License-Identifier: Apache-2.0
"""ROS log files; by default every process leaves one in ``~/.ros/log`` for ever."""

NO_LOG_FILE = ("--ros-args", "--disable-external-lib-logs")
"""Arguments of a process that writes none; it then needs no home directory."""
