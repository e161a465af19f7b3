# SPDX-License-Identifier: Apache-2.0
"""Management of learned profiles: show, undo, reset, export, forget."""
