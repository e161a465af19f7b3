# SPDX-License-Identifier: Apache-2.0
"""Test files: scenes to rehearse, and what is expected of them."""
