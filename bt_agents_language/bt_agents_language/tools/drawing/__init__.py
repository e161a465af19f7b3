# SPDX-License-Identifier: Apache-2.0
"""Drawings of trees as text and Mermaid."""
