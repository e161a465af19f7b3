# SPDX-License-Identifier: Apache-2.0
"""Trees rehearsed and tested on a virtual clock, without a robot and without ROS."""
