# SPDX-License-Identifier: Apache-2.0
"""Trees: from keys and values to checked nodes with their subtrees in place."""
