# SPDX-License-Identifier: Apache-2.0
"""What there is to say about each word of the language."""
