# SPDX-License-Identifier: Apache-2.0
"""From the text of a file to located nodes, and from a slip in it to words that mend it."""
