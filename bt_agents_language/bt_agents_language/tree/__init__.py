# SPDX-License-Identifier: Apache-2.0
"""From raw nodes to checked trees: fields, names, subtrees and calls."""
