# Only for colcon; pip and uv build from pyproject.toml.
import re
from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup


class WithoutPyproject(Distribution):
    """Takes what stands here and in setup.cfg: colcon cannot read what setuptools makes of pyproject.toml."""

    def parse_config_files(self, filenames=None, ignore_option_errors=False):
        super().parse_config_files(["setup.cfg"], ignore_option_errors)


setup(
    distclass=WithoutPyproject,
    name="crawler_ros",
    version=re.search(r'__version__ = "(.+)"', Path("crawler_model/__init__.py").read_text())[1],
    packages=find_packages(include=["crawler_*", "msgs_config"]),
    package_data={
        "crawler_model": ["py.typed"],
        "crawler_lab": ["py.typed"],
        "crawler_pictures.film": ["player.html"],
        "crawler_lab.play": ["page/*", "lessons/*"],
        "msgs_config": ["*.yaml", "*.json", "*.xml", "scenes/*.yaml"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/crawler_ros"]),
        ("share/crawler_ros", ["package.xml"]),
        ("share/crawler_ros/launch", sorted(glob("launch/*"))),
    ],
    zip_safe=False,
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "simulator = crawler_command.executables:simulator",
            "gait_player = crawler_command.executables:gait_player",
            "replay = crawler_command.executables:replay",
            "speed_control = crawler_command.executables:speed_control",
            "phase_control = crawler_command.executables:phase_control",
            "path_control = crawler_command.executables:path_control",
            "policy = crawler_lab.executables:policy",
            "plan = crawler_lab.executables:plan",
            "crawler = crawler_command.executables:crawler",
        ],
        "crawler.verbs": [
            "excite = crawler_lab.verbs.identify.excite:excite_command",
            "identify = crawler_lab.verbs.identify.command:identify_command",
            "optimise = crawler_lab.verbs.optimise:optimise_command",
            "play = crawler_lab.verbs.play:play",
            "predict = crawler_lab.verbs.identify.predict:predict_command",
            "springs = crawler_lab.verbs.springs:springs_command",
            "sweep = crawler_lab.verbs.sweep:sweep",
            "warm = crawler_lab.verbs.warm:warm",
        ],
    },
)
