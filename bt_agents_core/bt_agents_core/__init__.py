# SPDX-License-Identifier: Apache-2.0
"""What every part shares: scenes, profiles, errors, files and queues; no ROS, no YAML."""
