# SPDX-License-Identifier: Apache-2.0
"""Readers, one for each kind of file."""
