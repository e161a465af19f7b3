# SPDX-License-Identifier: Apache-2.0
"""Replay of a journal: decisions, learning and runs, computed again and compared."""
