# SPDX-License-Identifier: Apache-2.0
"""Readers of agents' tests and of the scenarios they play."""
