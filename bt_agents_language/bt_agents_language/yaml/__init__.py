# SPDX-License-Identifier: Apache-2.0
"""YAML with positions: located nodes, typed readers, diagnostics and their renderers."""
