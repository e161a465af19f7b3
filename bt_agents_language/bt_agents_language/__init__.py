# SPDX-License-Identifier: Apache-2.0
"""Readers that turn authors' files into checked specifications, and tools for these."""
