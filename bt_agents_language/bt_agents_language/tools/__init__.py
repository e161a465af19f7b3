# SPDX-License-Identifier: Apache-2.0
"""Authors' tools on checked files: check, lint, format, draw, schema, templates."""
