# SPDX-License-Identifier: Apache-2.0
"""Log files of ROS, of which every process would leave one in ``~/.ros/log`` for ever."""

NO_LOG_FILE = ("--ros-args", "--disable-external-lib-logs")
"""Arguments of a process that writes none; it needs no home then."""
