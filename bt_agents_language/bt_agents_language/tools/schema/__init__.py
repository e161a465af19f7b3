# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of all kinds of files."""
