# SPDX-License-Identifier: Apache-2.0
"""Trees from and to BehaviorTree.CPP and Groot2."""
