# SPDX-License-Identifier: Apache-2.0
"""Import and export of trees for BehaviorTree.CPP and Groot2."""
