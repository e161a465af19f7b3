# SPDX-License-Identifier: Apache-2.0
"""Diagnostic codes, each explained by a wrong and a right example."""
