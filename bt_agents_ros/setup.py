# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_ros as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_ros",
    version="0.1.0",
    description="Base node, executor, QoS, calls and parameters that all nodes share.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_ros", "bt_agents_ros.*"]),
    package_data={"bt_agents_ros": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_ros"]),
        ("share/bt_agents_ros", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={"console_scripts": ["one_process = bt_agents_ros.node_main:one_process"]},
)
