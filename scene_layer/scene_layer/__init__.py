# SPDX-License-Identifier: Apache-2.0
"""The scene layer: from readings to the vector that describes an interaction."""
