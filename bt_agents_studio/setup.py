# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_studio as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_studio",
    version="0.1.0",
    description="Shows a running system, and recordings of one, in a browser.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_studio", "bt_agents_studio.*"]),
    package_data={"bt_agents_studio": ["py.typed", "page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_studio"]),
        ("share/bt_agents_studio", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={
        "bt_agents.commands": [
            "studio = bt_agents_studio.commands:studio",
            "watch = bt_agents_studio.commands:watch",
        ]
    },
)
