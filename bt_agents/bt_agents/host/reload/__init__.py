# SPDX-License-Identifier: Apache-2.0
"""Reloading of changed files into a running host, with versions to roll back to."""
