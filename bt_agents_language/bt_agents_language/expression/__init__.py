# SPDX-License-Identifier: Apache-2.0
"""Expressions of the language: tokens, parser, operators and functions."""
