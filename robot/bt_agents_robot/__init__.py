# SPDX-License-Identifier: Apache-2.0
"""A simulated robot and its visitors, behind real ROS interfaces."""
