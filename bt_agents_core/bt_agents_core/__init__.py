# SPDX-License-Identifier: Apache-2.0
"""Shared core of all packages: scenes, profiles, errors, files and queues; no ROS, no YAML."""
