# SPDX-License-Identifier: Apache-2.0
"""Node types of the language: one file for each kind of node and each decorator."""
