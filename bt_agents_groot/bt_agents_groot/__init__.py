# SPDX-License-Identifier: Apache-2.0
"""Trees of BehaviorTree.CPP v4 (Groot2) read into our language, and ours written for Groot2."""
