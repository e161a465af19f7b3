# SPDX-License-Identifier: Apache-2.0
"""Installs feedback_node as a ROS package."""

from setuptools import find_packages, setup

setup(
    name="feedback_node",
    version="0.1.0",
    description="Turns moods and buttons into feedback and keeps the learned profiles.",
    license="Apache-2.0",
    maintainer="bt-agents maintainers",
    maintainer_email="maintainers@bt-agents.invalid",
    packages=find_packages(include=["feedback_node", "feedback_node.*"]),
    package_data={"feedback_node": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/feedback_node"]),
        ("share/feedback_node", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest", "hypothesis"]},
    zip_safe=True,
    entry_points={"console_scripts": ["feedback = feedback_node:main"]},
)
