# SPDX-License-Identifier: Apache-2.0
"""Human-readable reasons for decisions."""
