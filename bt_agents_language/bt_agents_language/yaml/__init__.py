# SPDX-License-Identifier: Apache-2.0
"""YAML with positions: located nodes, syntax hints, field tables and typed readers."""
