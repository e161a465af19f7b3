# SPDX-License-Identifier: Apache-2.0
"""Behaviours of the shape of those of py_trees_ros, for tests where that is not installed."""
