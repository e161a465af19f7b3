# SPDX-License-Identifier: Apache-2.0
"""Decides, learns and ticks again what a journal holds, and says what is not equal."""
