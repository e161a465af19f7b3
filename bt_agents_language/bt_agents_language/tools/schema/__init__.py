# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of every kind of file, for completion and hover in an author's editor."""
