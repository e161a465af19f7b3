# SPDX-License-Identifier: Apache-2.0
"""Processes of a running system: how they start, restart and end."""
