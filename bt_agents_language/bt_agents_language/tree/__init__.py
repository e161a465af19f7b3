# SPDX-License-Identifier: Apache-2.0
"""Trees of a file: raw nodes, their fields, names, subtrees and calls."""
