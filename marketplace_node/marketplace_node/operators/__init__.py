# SPDX-License-Identifier: Apache-2.0
"""Operators' means: pins, vetoes, awards, previews, statistics."""
