# SPDX-License-Identifier: Apache-2.0
"""The agent host and what all ROS nodes of the project share."""
