# SPDX-License-Identifier: Apache-2.0
"""Behaviours with the shape of py_trees_ros, for tests without that package."""
