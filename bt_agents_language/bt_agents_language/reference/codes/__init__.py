# SPDX-License-Identifier: Apache-2.0
"""Codes of diagnostics, each documented by a wrong and a right example."""
