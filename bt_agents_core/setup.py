# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_core as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_core",
    version="0.1.0",
    description="Scenes, profiles, errors, files and queues that every part shares.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_core", "bt_agents_core.*"]),
    package_data={"bt_agents_core": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_core"]),
        ("share/bt_agents_core", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
)
