# SPDX-License-Identifier: Apache-2.0
"""Concepts of all packages: scenes, profiles, errors, files and queues; no ROS, no YAML."""
