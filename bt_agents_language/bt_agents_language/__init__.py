# SPDX-License-Identifier: Apache-2.0
"""The authors' files as checked specifications, and every tool that works on them."""
