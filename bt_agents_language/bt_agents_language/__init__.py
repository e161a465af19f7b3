# SPDX-License-Identifier: Apache-2.0
"""Interaction scripts as text: read, checked and explained with positions, without ROS."""
