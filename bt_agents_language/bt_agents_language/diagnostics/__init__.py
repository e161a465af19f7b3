# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a file: their collection, hints about names, and their renderers."""
