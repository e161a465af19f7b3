# SPDX-License-Identifier: Apache-2.0
"""Values that change while agents are at work: what they may be, what they were, what stays."""
