# SPDX-License-Identifier: Apache-2.0
"""Replacements for parts of rclpy 7.1.6; each names the upstream problem and when to remove it."""
