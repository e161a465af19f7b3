# SPDX-License-Identifier: Apache-2.0
"""Installs bt_agents_language as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="bt_agents_language",
    version="0.1.0",
    description="The authors' files as checked specifications, and every tool that works on them.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["bt_agents_language", "bt_agents_language.*"]),
    package_data={
        "bt_agents_language": [
            "py.typed",
            "expression/*.yaml",
            "reference/*.md",
            "reference/*.yaml",
            "tools/templates/*.yaml",
            "tools/templates/patterns/*.yaml",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/bt_agents_language"]),
        ("share/bt_agents_language", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
)
