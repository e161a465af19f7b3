# SPDX-License-Identifier: Apache-2.0
"""Expressions: their words, kinds, dimensions, operators and functions."""
