# SPDX-License-Identifier: Apache-2.0
"""The ROS node that hosts agents: bids, runs, tunables, reloading."""
