# SPDX-License-Identifier: Apache-2.0
"""Replay of the decisions, profile changes and runs in a journal, and what-if analysis."""
