# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents",
    version="0.1.0",
    description="The tree language, the engine and the host of behaviour-tree agents.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents", "bt_agents.*"]),
    package_data={"bt_agents": ["py.typed", "ros/*.xml", "language/*/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents"]),
        ("share/bt_agents", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "agents = bt_agents_ros.node_main:agents",
            "bt-agents = bt_agents_tools.cli:main",
        ],
        "pytest11": ["bt_agents = bt_agents_tools.rehearsal.pytest_plugin"],
    },
)
