# SPDX-License-Identifier: Apache-2.0
"""The engine: trees of behaviours, built from specifications, ticked on an injected clock."""
