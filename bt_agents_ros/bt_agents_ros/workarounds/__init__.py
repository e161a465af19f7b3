# SPDX-License-Identifier: Apache-2.0
"""Replacements for parts of rclpy, each until upstream has mended what it names."""
