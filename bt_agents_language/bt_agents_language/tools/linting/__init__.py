# SPDX-License-Identifier: Apache-2.0
"""Warnings about trees that can be read but will not do what they say."""
