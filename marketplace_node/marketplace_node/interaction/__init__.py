# SPDX-License-Identifier: Apache-2.0
"""One interaction from its scene to its end: admission, award, preemption, failover."""
