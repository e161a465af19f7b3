# SPDX-License-Identifier: Apache-2.0
"""Pictures of an agent's tree as text, Mermaid and SVG, every decorator as a node of its own."""
