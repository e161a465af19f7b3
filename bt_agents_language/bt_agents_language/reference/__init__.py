# SPDX-License-Identifier: Apache-2.0
"""Reference pages of node types, topics and diagnostic codes."""
