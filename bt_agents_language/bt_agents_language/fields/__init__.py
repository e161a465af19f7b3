# SPDX-License-Identifier: Apache-2.0
"""Fields in any file: values, names in scope, inputs, and bindings to ROS interfaces."""
