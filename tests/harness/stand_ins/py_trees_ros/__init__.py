# SPDX-License-Identifier: Apache-2.0
"""Behaviours shaped like those of py_trees_ros, for tests without that package."""
