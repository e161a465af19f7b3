# SPDX-License-Identifier: Apache-2.0
"""The environment of a tree over ROS: goals, inboxes, clock."""
