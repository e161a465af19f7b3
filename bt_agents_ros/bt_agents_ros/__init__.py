# SPDX-License-Identifier: Apache-2.0
"""Toolkit of every ROS node: base node, executor, QoS profiles, calls and parameters."""
