# SPDX-License-Identifier: Apache-2.0
"""Warnings about what is legal but rarely meant."""
