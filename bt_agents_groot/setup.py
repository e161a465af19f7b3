# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_groot as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_groot",
    version="0.1.0",
    description="Trees from and to BehaviorTree.CPP and Groot2.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_groot", "bt_agents_groot.*"]),
    package_data={"bt_agents_groot": ["py.typed", "builtins.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_groot"]),
        ("share/bt_agents_groot", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "bt_agents.commands": [
            "export = bt_agents_groot.commands:export",
            "import = bt_agents_groot.commands:import_",
        ]
    },
)
