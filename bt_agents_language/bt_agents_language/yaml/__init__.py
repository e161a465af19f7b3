# SPDX-License-Identifier: Apache-2.0
"""YAML text: located nodes, and hints and fix-its for its syntax errors."""
