# SPDX-License-Identifier: Apache-2.0
"""Behaviour trees built from specs and ticked on an injected clock and world, without ROS."""
