import re
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "iolspi_ros"
HERE = Path(__file__).parent
VERSION = re.search(
    r'__version__ = "([^"]+)"', (HERE / PACKAGE / "__init__.py").read_text(encoding="utf-8")
).group(1)


def tree(folder: str) -> list[tuple[str, list[str]]]:
    """Files of a folder, each under share/, for installation."""
    found: dict[str, list[str]] = {}
    for path in sorted((HERE / folder).rglob("*")):
        if path.is_file():
            place = path.relative_to(HERE)
            found.setdefault(f"share/{PACKAGE}/{place.parent}", []).append(str(place))
    return list(found.items())


setup(
    name=PACKAGE,
    version=VERSION,
    packages=find_packages(include=["iolspi_ros*", "sim_nodes*", "msg_bridge*"]),
    package_data={"iolspi_ros": ["static/*"], "msg_bridge.cockpit": ["static/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *tree("config"),
        *tree("launch"),
        *tree("demos"),
    ],
    python_requires=">=3.11,<3.14",
    install_requires=["setuptools"],
    extras_require={
        "cluster": ["distributed"],
        "bench": ["mushroom-rl==1.10.2"],
        "gymnasium": ["gymnasium[box2d]>=1.0"],
        "minari": ["minari[hdf5]>=0.5.3"],
        "lerobot": ["lerobot>=0.4"],
        "cockpit": ["nicegui>=3"],
        "trees": ["scikit-learn>=1.5"],
        "deep": ["stable-baselines3>=2.4", "gymnasium>=1.0"],
    },
    zip_safe=True,
    description="Informed Online Least-Squares Policy Iteration on a ROS 2 graph",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "iolspi = iolspi_ros.cli:main",
            "simulator = iolspi_ros.nodes.start:simulator",
            "demonstrator = iolspi_ros.nodes.start:demonstrator",
            "learner = iolspi_ros.nodes.start:learner",
            "bridge = iolspi_ros.nodes.start:bridge",
            "vehicle = iolspi_ros.nodes.start:vehicle",
            "cockpit = iolspi_ros.nodes.start:cockpit",
            "graph = iolspi_ros.nodes.start:graph",
        ],
        "iolspi_ros.tasks": [
            "pendulum = sim_nodes.tasks.pendulum:Pendulum",
            "slung_load = sim_nodes.tasks.slung_load:SlungLoad",
            "slung_load_3d = sim_nodes.tasks.slung_load_3d:SlungLoad3D",
            "cart_pole = sim_nodes.tasks.cart_pole:CartPole",
        ],
        "gymnasium.envs": ["iolspi_ros = msg_bridge.gym:register"],
        "iolspi_ros.learners": [
            "iolspi = iolspi_ros.core.online:OnlineLSPI",
            "iolspi_symmetric = iolspi_ros.core.symmetric:SymmetricLSPI",
            "sarsa = iolspi_ros.methods.temporal_difference:Sarsa",
            "q_learning = iolspi_ros.methods.temporal_difference:QLearning",
            "policy_search = iolspi_ros.methods.policy_search:PolicySearch",
            "value_iteration = iolspi_ros.methods.value_iteration:ValueIteration",
            "continuous_value_iteration = "
            "iolspi_ros.methods.value_iteration:ContinuousValueIteration",
            "automata = iolspi_ros.methods.automata:Automata",
            "apprentice = iolspi_ros.methods.apprentice:Apprentice",
            "fitted_q = iolspi_ros.methods.fitted_q:FittedQ",
        ],
    },
)
