# SPDX-License-Identifier: Apache-2.0
"""Streams of trees and their blackboards for the tools of py_trees_ros."""
